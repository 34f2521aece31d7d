"""The map of detections that are there already equals that of the run that made them."""

from __future__ import annotations

import csv
import json
import random
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from actors.cli import app
from pipeline.errors import InputError
from pipeline.fusion.map_file import map_records
from pipeline.messages import Detections, Message
from pipeline.mission.fuse import LookedAt, fuse
from pipeline.mission.local import FinishedRun, make_reducer, process
from pipeline.mission.own_detections import OwnDetector
from pipeline.mission.planning import plan
from pipeline.mission.prepared import prepare

ANY_SCORE = OwnDetector(min_score=0.0)


@dataclass(frozen=True, eq=False)
class Made:
    """A run with one detector, and what it detected."""

    mission: Path
    run: FinishedRun
    results: list[Detections]


@pytest.fixture(scope="module")
def made(small_mission: Path, tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("fuse") / "mission"
    shutil.copytree(small_mission.parent, folder)
    mission = folder / "mission.yaml"
    text = mission.read_text().replace("detectors_per_stream: 2", "detectors_per_stream: 1")
    mission.write_text(text.replace("detectors_per_frame: 2", "detectors_per_frame: 1"))
    pool = yaml.safe_load((folder / "pool.yaml").read_text())
    pool["detectors"] = pool["detectors"][:1]
    # as accurate at every bitrate as at its best, which is what fuse takes own detections for
    pool["detectors"][0] |= {"accuracy": [{"bitrate": {"mbps": 1}, "accuracy": 0.9}], "accuracy_by_codec": []}
    (folder / "pool.yaml").write_text(yaml.safe_dump(pool))
    prepared = prepare(mission)
    chosen = plan(prepared)
    results: list[Detections] = []
    reducer = make_reducer(prepared, chosen, lateness=False)

    def push(message: Message) -> None:
        results.extend([message] if isinstance(message, Detections) else [])
        reducer.push(message)

    done = process(prepared, chosen, push, lambda *_: None)
    reducer.finish()
    # a team without a plan needs neither
    (folder / "pool.yaml").unlink()
    (folder / "inventory.yaml").unlink()
    return Made(mission, FinishedRun(chosen, reducer, done.counts, done.bytes_sent, 1.0, "local"), results)


def rows_of(results: list[Detections]) -> list[list[Any]]:
    """Every box, and a row without one for each frame that shows none."""
    rows: list[list[Any]] = []
    for r in results:
        boxes = zip(r.boxes_px.tolist(), r.scores.tolist(), strict=True)
        rows += [[r.stream, r.index, *box, score, "person"] for box, score in boxes]
        rows += [] if len(r.scores) else [[r.stream, r.index, "", "", "", "", "", ""]]
    return rows


def write_csv(path: Path, rows: list[list[Any]]) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([["stream", "frame", "x0", "y0", "x1", "y1", "score", "class"], *rows])
    return path


def write_coco(folder: Path, results: list[Detections]) -> tuple[Path, Path]:
    images = [{"id": k, "file_name": f"{r.stream}/{r.index:06d}.jpg"} for k, r in enumerate(results)]
    boxes = [
        {"image_id": k, "category_id": 1, "bbox": [x0, y0, x1 - x0, y1 - y0], "score": score}
        for k, r in enumerate(results)
        for (x0, y0, x1, y1), score in zip(r.boxes_px.tolist(), r.scores.tolist(), strict=True)
    ]
    categories = [{"id": 1, "name": "person"}]
    (folder / "results.json").write_text(json.dumps(boxes))
    (folder / "images.json").write_text(json.dumps({"images": images, "categories": categories}))
    return folder / "results.json", folder / "images.json"


def map_of(run: FinishedRun) -> list[bytes]:
    return list(map_records(run.reducer.fuser.map))


def fused(
    made: Made, detections: Path, images: Path | None = None, looked_at: LookedAt | None = None
) -> FinishedRun:
    return fuse(made.mission, detections, images, looked_at, ANY_SCORE)[1]


def test_detections_of_a_run_give_the_map_of_that_run_in_any_order_of_rows(
    made: Made, tmp_path: Path
) -> None:
    rows = rows_of(made.results)
    assert sum(bool(row[-1]) for row in rows) > 10
    assert any(not row[-1] for row in rows)
    for seed in (None, 1):
        if seed is not None:
            random.Random(seed).shuffle(rows)
        run = fused(made, write_csv(tmp_path / "dets.csv", rows))
        assert map_of(run) == map_of(made.run)


def test_coco_results_give_the_map_too_if_the_rest_was_looked_at(made: Made, tmp_path: Path) -> None:
    results, images = write_coco(tmp_path, made.results)
    with pytest.raises(InputError, match=r"images without a result; expected --looked-at all .* or --looked"):
        fused(made, results, images)
    run = fused(made, results, images, "all")
    looks = run.reducer.fuser.looks
    assert len(looks) == len(made.run.reducer.fuser.looks)
    # x + (x1 - x) is not always x1, so the map is compared in its cells, not in its bits
    theirs, ours = made.run.reducer.fuser.map, run.reducer.fuser.map
    assert abs(theirs.log_odds - ours.log_odds).max() < 1e-4
    assert (theirs.looks == ours.looks).all()


def test_a_frame_that_is_not_listed_lowers_nothing(made: Made, tmp_path: Path) -> None:
    with_box = [row for row in rows_of(made.results) if row[-1]]
    run = fused(made, write_csv(tmp_path / "dets.csv", with_box))
    all_of_them = fused(made, write_csv(tmp_path / "dets.csv", with_box), looked_at="all")
    assert run.reducer.fuser.map.looks.sum() < all_of_them.reducer.fuser.map.looks.sum()
    frames = {(row[0], row[1]) for row in with_box}
    assert sum(len(p) for p in run.reducer.processed.values()) == len(frames)


def test_the_command_writes_a_run_directory_that_says_where_the_detections_come_from(
    made: Made, tmp_path: Path
) -> None:
    rows = [*rows_of(made.results), ["drone-9", 3, 1, 2, 3, 4, 0.5, "person"]]
    detections = write_csv(tmp_path / "theirs.csv", rows)
    arguments = [
        "fuse",
        made.mission,
        "--detections",
        detections,
        "--out",
        tmp_path / "run",
        "--min-score",
        "0",
    ]
    outcome = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert outcome.exit_code == 0
    summary = json.loads((tmp_path / "run/summary.json").read_text())
    said = "\n".join(summary["own_detections"])
    assert "theirs.csv" in said
    assert "accuracy relative to the sensor model's best: 1, assumed" in said
    assert "left out: 1 unknown stream (first: " in said
    for stream in summary["streams"]:
        assert stream["captured"] == stream["processed"] + sum(stream["dropped"].values())
        assert stream["dropped"]["not_listed"] > 0
    report = (tmp_path / "run/report.html").read_text()
    assert "Where the detections come from" in report
    assert "<h2>Plan</h2>" not in report


def test_a_stated_accuracy_weakens_every_look(made: Made, tmp_path: Path) -> None:
    detections = write_csv(tmp_path / "dets.csv", rows_of(made.results))
    half = fuse(made.mission, detections, None, None, OwnDetector(min_score=0.0, accuracy=0.5))[1]
    full = fused(made, detections)
    assert max(k.p for k in half.reducer.fuser.looks) < max(k.p for k in full.reducer.fuser.looks)
    assert any("0.5, stated" in sentence for sentence in half.own_detections)


def test_detections_of_nothing_in_the_mission_are_refused_with_the_reasons(
    made: Made, tmp_path: Path
) -> None:
    detections = write_csv(tmp_path / "dets.csv", [["x", 1, 1, 2, 3, 4, 0.5, "person"]])
    with pytest.raises(InputError, match=r"no frame that can be used \(unknown stream: 1\)"):
        fused(made, detections)
