"""The shipped thermal detectors: what their cards say, and real pictures where they are at hand."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.config.evaluation import load_evaluation
from pipeline.config.pool import load_pool
from pipeline.detection import load_detector, open_pool_detector
from pipeline.detection.nms import iou
from pipeline.detection.picture_file import read_picture
from pipeline.training.config import load_training

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "configs" / "detectors"
SHARED = ROOT.parent / "shared" / "data" / "thermal"
POOL = load_pool(ROOT / "configs" / "pools" / "thermal.yaml").detectors
FAMILY = tuple(row.id for row in POOL)
CARDS = {name: yaml.safe_load((FOLDER / f"{name}.card.yaml").read_text()) for name in FAMILY}
RECIPES = {name: yaml.safe_load((FOLDER / f"{name}.train.yaml").read_text()) for name in FAMILY}


@pytest.mark.parametrize("name", FAMILY)
def test_a_card_says_that_its_pictures_are_real_and_whose_they_are(name):
    card = CARDS[name]
    assert card["pictures"] == "real"
    assert "HIT-UAV" in card["attribution"]
    assert "CC BY 4.0" in card["attribution"]
    assert card["training"] == RECIPES[name]
    assert (FOLDER / f"{name}.onnx").stat().st_size < 6e6


@pytest.mark.parametrize("name", FAMILY)
def test_the_headline_flights_were_neither_learned_nor_calibrated_on(name):
    given = load_training(FOLDER / f"{name}.train.yaml").labelled
    assert set(given.test) == {1, 3, 4}
    assert not set(given.test) & {*given.train, *given.calibration}
    held_out = CARDS[name]["held_out"]
    assert set(held_out["by"]["flight"]) == {"1", "3", "4"}
    assert (held_out["clean"]["pictures"], held_out["clean"]["people"]) == (1013, 1528)


@pytest.mark.parametrize("row", POOL, ids=FAMILY)
def test_the_pool_has_the_card_s_threshold_and_calibration(row):
    scores = CARDS[row.id]["scores"]
    assert row.score_threshold == scores["threshold"]
    assert (row.calibration and row.calibration.model_dump()) == scores["calibration"]
    metadata = open_pool_detector(row).recognised.facts.metadata
    assert metadata["trained_on"].startswith("real pictures: HIT-UAV")


def test_the_evaluation_looks_at_held_out_flights_with_the_cards_scores():
    evaluation = load_evaluation(ROOT / "configs" / "evaluations" / "thermal.yaml")
    (source,) = evaluation.datasets
    assert set(source.sequences.only) <= {1, 3, 4}
    for detector in evaluation.detectors:
        scores = CARDS[detector.id]["scores"]
        assert detector.score_threshold == scores["threshold"]
        assert (detector.calibration is None) == (scores["calibration"] is None)


def test_an_even_picture_is_empty():
    rng = np.random.default_rng(3)
    picture = np.clip(rng.normal(70, 4, (512, 640, 1)), 0, 255).astype(np.uint8).repeat(3, 2)
    for row in POOL:
        assert len(open_pool_detector(row).detect(picture)[0]) == 0


@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared thermal pictures are absent")
@pytest.mark.parametrize("name", FAMILY)
def test_people_of_a_held_out_flight_are_found_as_often_as_the_card_says(name):
    document = json.loads((SHARED / "annotations.json").read_text())
    images = [i for i in document["images"] if i["flight"] == 1]
    people: dict[int, list[list[float]]] = {}
    for a in document["annotations"]:
        if a["category_id"] == 1 and not a["iscrowd"]:
            people.setdefault(a["image_id"], []).append(a["bbox"])
    detector = load_detector(FOLDER / f"{name}.onnx", score_threshold=CARDS[name]["scores"]["threshold"])
    found = seen = 0
    for image in images[::4]:
        boxes = detector.detect(read_picture(SHARED / image["file_name"]))[0]
        for x, y, w, h in people.get(image["id"], []):
            seen += 1
            found += bool(len(boxes) and (iou(np.array([x, y, x + w, y + h], float), boxes) >= 0.5).any())
    assert seen >= 50
    assert found / seen == pytest.approx(CARDS[name]["held_out"]["by"]["flight"]["1"]["recall"], abs=0.1)
