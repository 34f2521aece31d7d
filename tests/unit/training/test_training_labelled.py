"""Real pictures with labels: what is learned from, what is measured on, and what is refused."""

from __future__ import annotations

import datetime
import json
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import yaml
from matplotlib.image import imsave

from pipeline.errors import InputError
from pipeline.training.config import load_training
from pipeline.training.labelled import part, prepare_labelled

NEEDS_TORCH = "the extra [train] is not installed"
FLIGHTS = (0, 1, 2)
SIZE = (160, 128)


def silent(*_):
    pass


@pytest.fixture
def folder(tmp_path) -> Path:
    """Four pictures of each of three flights: a bright person on grey, and a crowd without count in flight 0."""
    rng = np.random.default_rng(5)
    images, annotations = [], []
    for flight in FLIGHTS:
        for shot in range(4):
            number, name = len(images) + 1, f"{flight}_{shot}.png"
            picture = rng.integers(60, 100, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
            x, y = int(rng.integers(0, SIZE[0] - 12)), int(rng.integers(0, SIZE[1] - 20))
            picture[y : y + 20, x : x + 12] = 240
            imsave(tmp_path / name, picture)
            night = shot % 2 == 0
            images.append(
                {"id": number, "file_name": name, "width": SIZE[0], "height": SIZE[1], "flight": flight,
                 "night": night, "height_m": 60 + 20 * flight}
            )  # fmt: skip
            box = {"image_id": number, "category_id": 1, "bbox": [x, y, 12, 20], "area": 240, "iscrowd": 0}
            annotations.append(box | {"id": len(annotations) + 1})
            if flight == 0:
                crowd = box | {"id": len(annotations) + 1, "bbox": [0, 0, 40, 30], "iscrowd": 1}
                annotations.append(crowd)
    document = {"images": images, "annotations": annotations, "categories": [{"id": 1, "name": "person"}]}
    (tmp_path / "labels.json").write_text(json.dumps(document))
    return tmp_path


@pytest.fixture
def recipe(folder) -> Path:
    return written(folder, {})


def written(folder: Path, changes: dict) -> Path:
    document = {
        "name": "tiny",
        "purpose": "squares",
        "input": {"width": 160, "height": 128},
        "network": {"channels": [4, 8, 8, 16], "blocks": [0, 1], "head": 8, "stride": 4},
        "labelled": {
            "labels": "labels.json", "split_by": "flight", "train": [0], "calibration": [1], "test": [2],
            "by": {"night": [], "height_m": [90]}, "sizes": [14], "attribution": "nobody",
        },
        "augmentation": {
            "crop": 96, "scale_min": 0.9, "scale_max": 1.2, "on_person": 0.8, "degraded": 0.3, "light": 0.1,
            "tint": 0.0, "noise": 2.0, "blur": 0.1, "visible_min": 0.3, "edge_min": 3.0,
        },
        "optimisation": {
            "seed": 1, "steps": 60, "cycles": 1, "batch": 4, "learning_rate": 0.01, "weight_decay": 0.01,
            "warmup_steps": 5, "ema_decay": 0.9, "save_every": 30, "threads": 1, "half_precision": False,
        },
    }  # fmt: skip
    for key, value in changes.items():
        *way, last = key.split(".")
        place = document
        for step in way:
            place = place[step]
        if value is None:
            del place[last]
        else:
            place[last] = value
    path = folder / "tiny.train.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


def pictures_of(recipe: Path, folder: Path):
    given = load_training(recipe).labelled
    return given, prepare_labelled(given, recipe.parent, folder / "out", silent)


def test_no_picture_is_in_two_parts_and_each_has_its_own_people(recipe, folder):
    given, pictures = pictures_of(recipe, folder)
    parts = [part(pictures, given, groups) for groups in (given.train, given.calibration, given.test)]
    assert [len(p) for p in parts] == [4, 4, 4]
    assert all(not set(a.numbers) & set(b.numbers) for a, b in combinations(parts, 2))
    for own, flight in zip(parts, FLIGHTS, strict=True):
        assert {pictures.attributes[i]["flight"] for i in own.numbers} == {flight}
        for i in own.numbers:
            x0, y0, x1, y1 = pictures.boxes_px[i][0].astype(int)
            assert pictures.clean[i][y0:y1, x0:x1].min() == 240
            assert pictures.degraded[i][y0 + 4 : y1 - 4, x0 + 4 : x1 - 4].mean() > 180


def test_a_crowd_is_neither_learned_nor_counted(recipe, folder):
    given, pictures = pictures_of(recipe, folder)
    visible = [pictures.visible_shares[i].tolist() for i in part(pictures, given, (0,)).numbers]
    assert visible == [[1.0, 0.0]] * 4


def test_what_was_written_is_used_again_but_not_for_other_flights(recipe, folder):
    pictures_of(recipe, folder)
    (folder / "0_0.png").unlink()
    pictures_of(recipe, folder)
    fewer = written(folder, {"labelled.test": [0], "labelled.train": [2]})
    pictures_of(fewer, folder)
    with pytest.raises(InputError, match="other pictures"):
        pictures_of(written(folder, {"labelled.categories": ["person", "car"]}), folder)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"labelled.test": [7]}, r"labels\.json: found no image of flight 7; expected one of 0, 1, 2"),
        ({"labelled.split_by": "pilot"}, r"images\.0\.pilot.*None.*a number or a text"),
        ({"labelled.labels": "none.json"}, r"none\.json.*no file"),
        ({"labelled.categories": ["sheep"]}, r"categories.*person.*sheep"),
        ({"labelled.test": [0]}, r"labelled\.test.*flight 0, which is in train too"),
        ({"labelled": None}, r"neither data nor labelled"),
        ({"labelled.calibration": []}, r"labelled\.calibration.*neither calibration nor folds"),
        ({"labelled.folds": [[0]]}, r"labelled\.calibration.*both"),
        ({"labelled.calibration": [], "labelled.folds": [[0]]}, r"labelled\.folds\.0.*\[0\].*not all"),
        ({"labelled.calibration": [], "labelled.train": [0, 1], "labelled.folds": [[2]]},
         r"labelled\.folds.*flight 2.*groups of train"),
        ({"labelled.calibration": [], "labelled.train": [0, 1], "labelled.folds": [[1], [1]]},
         r"labelled\.folds.*flight 1.*each in one fold"),
        ({"data": {p: {"seed": 1, "scenes": 1, "pictures": 1} for p in ("train", "mission", "sizes")}},
         r"data and labelled"),
        ({"purpose": None}, r"purpose.*no purpose"),
        ({"network.stride": 6}, r"network\.stride"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named(folder, change, words):
    with pytest.raises(InputError, match=words):
        pictures_of(written(folder, change), folder)


def test_a_picture_of_another_size_than_labelled_is_refused(recipe, folder):
    imsave(folder / "1_2.png", np.zeros((64, 64, 3), np.uint8))
    with pytest.raises(InputError, match=r"1_2\.png.*64 x 64.*160 x 128"):
        pictures_of(recipe, folder)


def test_a_training_on_labelled_pictures_ends_in_a_detector_and_an_honest_card(recipe, folder):
    pytest.importorskip("torch", reason=NEEDS_TORCH)
    from pipeline.training.train import train

    model = train(recipe, folder / "out", progress=silent)
    card = yaml.safe_load(model.with_suffix(".card.yaml").read_text())
    assert card["pictures"] == "real"
    assert card["attribution"] == "nobody"
    assert card["trained"] == datetime.date.today()
    assert card["training"] == yaml.safe_load(recipe.read_text())
    held_out = card["held_out"]
    assert held_out["clean"]["people"] == 4
    assert set(held_out["by"]["night"]) == {"True", "False"}
    assert {k: v["pictures"] for k, v in held_out["by"]["height_m"].items()} == {"from 90": 4}
    assert held_out["by_size_px"]["below 14"]["people"] == 0
    assert held_out["by_size_px"]["from 14"]["people"] == 4
    assert "flight 1" in card["scores"]["from"]
    # resumed where it ended: nothing is trained again, the same file comes out
    before = model.read_bytes()
    assert train(recipe, folder / "out", progress=silent).read_bytes() == before


def watch_what_is_learned(monkeypatch) -> dict[tuple[int, ...], int]:
    """Flights that a training learns from: how many crops."""
    learned: dict[tuple[int, ...], int] = {}
    from pipeline.training import optimiser

    real = optimiser.random_crop

    def watched(pictures, *args):
        flights = tuple(sorted({pictures.attributes[i]["flight"] for i in pictures.numbers}))
        learned[flights] = learned.get(flights, 0) + 1
        return real(pictures, *args)

    monkeypatch.setattr(optimiser, "random_crop", watched)
    return learned


def test_where_no_flight_can_be_spared_scores_come_from_networks_that_had_not_seen_them(folder, monkeypatch):
    pytest.importorskip("torch", reason=NEEDS_TORCH)
    from pipeline.training.train import train

    learned = watch_what_is_learned(monkeypatch)
    changes = {"train": [0, 1], "calibration": [], "folds": [[0], [1]]}
    recipe = written(folder, {f"labelled.{key}": value for key, value in changes.items()})
    model = train(recipe, folder / "out", progress=silent)
    assert set(learned) == {(0, 1), (1,), (0,)}
    scores = yaml.safe_load(model.with_suffix(".card.yaml").read_text())["scores"]
    assert "8 pictures of flight 0 and of 1, seen by networks of this recipe" in scores["from"]
    assert scores["unseen"]["people"] == 8
    assert scores["rule"] in scores["cross_validated_error_of_each_rule"]


def test_leaving_one_flight_out_never_learns_from_it(recipe, folder, monkeypatch):
    pytest.importorskip("torch", reason=NEEDS_TORCH)
    from pipeline.training.leave_one_out import leave_one_out

    learned = watch_what_is_learned(monkeypatch)
    shown = []
    folds = leave_one_out(recipe, folder / "out", steps=3, progress=silent, finished=shown.append)
    assert [f.left_out for f in folds] == [0, 1, 2]
    assert folds == shown
    assert set(learned) == {(1, 2), (0, 2), (0, 1)}
    assert all(f.result["people"] == 4 for f in folds)
    # resumed: the same figures
    assert leave_one_out(recipe, folder / "out", steps=3, progress=silent, finished=silent) == folds
