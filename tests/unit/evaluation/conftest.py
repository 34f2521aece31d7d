"""Real truth and detections that this project did not write (SeaDronesSee's validation set)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pipeline.evaluation.metrics.boxes import FoundBoxes, TrueBoxes, found_boxes, true_boxes

REAL = Path(__file__).parents[4] / "shared/data/evaluation"


@pytest.fixture(scope="session")
def real_boxes() -> tuple[TrueBoxes, FoundBoxes, int]:
    """Truth, detections and number of pictures."""
    if not REAL.is_dir():
        pytest.skip(f"{REAL} is not there")
    truth = json.loads((REAL / "instances_val.json").read_text())
    found = json.loads((REAL / "result_all_classes.json").read_text())
    index = {key: k for k, key in enumerate(sorted(image["id"] for image in truth["images"]))}
    marks = truth["annotations"]
    return (
        true_boxes(
            [index[a["image_id"]] for a in marks],
            [a["category_id"] for a in marks],
            [a["bbox"] for a in marks],
            [a["area"] for a in marks],
        ),
        found_boxes(
            [index[d["image_id"]] for d in found],
            [d["category_id"] for d in found],
            [d["bbox"] for d in found],
            [d["score"] for d in found],
        ),
        len(index),
    )
