"""Figures of labelled pictures, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.evaluation.metrics.boxes import found_boxes, true_boxes
from pipeline.training.config import LabelledPictures
from pipeline.training.labelled_accuracy import (
    Looked,
    accuracy,
    by_attribute,
    by_size,
)
from pipeline.training.score_use import calibration_errors, score_use

SMALL, LARGE, CROWD = [10, 10, 6, 12], [60, 10, 20, 40], [100, 0, 50, 50]


def looked(found: list[tuple[int, list[int], float]]) -> Looked:
    """Pictures 0 and 1 by night and day, each with a small and a large person; picture 1 with a crowd."""
    truth = true_boxes(
        [0, 0, 1, 1, 1], [1] * 5, [SMALL, LARGE, SMALL, LARGE, CROWD], None, [False] * 4 + [True]
    )
    image, boxes, scores = zip(*found, strict=True)
    return Looked(
        truth,
        found_boxes(image, [1] * len(found), boxes, scores),
        ({"night": True, "height_m": 70}, {"night": False, "height_m": 120}),
    )


def test_what_lies_in_a_crowd_is_neither_right_nor_wrong():
    every = [(0, SMALL, 0.9), (0, LARGE, 0.9), (1, SMALL, 0.8), (1, LARGE, 0.8), (1, [110, 10, 8, 12], 0.95)]
    result = accuracy(looked(every), 0.5)
    assert (result["people"], result["recall"], result["precision"], result["ap50"]) == (4, 1.0, 1.0, 1.0)
    assert result["wrong_boxes_per_picture"] == 0.0


def test_recall_and_wrong_boxes_are_those_at_the_threshold():
    result = accuracy(looked([(0, SMALL, 0.9), (0, LARGE, 0.3), (1, [0, 60, 9, 9], 0.6)]), 0.5)
    assert (result["recall"], result["precision"], result["wrong_boxes_per_picture"]) == (0.25, 0.5, 0.5)


def test_by_size_and_by_attribute():
    found = looked([(0, SMALL, 0.9), (0, LARGE, 0.9), (1, LARGE, 0.8)])
    sizes = by_size(found, (12.0,))
    assert sizes["below 12"] == {"people": 2, "ap50": pytest.approx(0.5, abs=0.01)}
    assert sizes["from 12"] == {"people": 2, "ap50": 1.0}
    data = LabelledPictures(
        labels="x", split_by="night", train=(1,), calibration=(2,), test=(3,), attribution="x",
        by={"night": (), "height_m": (100.0,)},
    )  # fmt: skip
    parts = by_attribute(found, data, 0.5)
    assert parts["night"]["True"]["recall"] == 1.0
    assert parts["night"]["False"]["recall"] == 0.5
    assert parts["height_m"]["below 100"] == parts["night"]["True"]
    assert parts["height_m"]["from 100"] == parts["night"]["False"]


def test_calibration_makes_probabilities_of_scores_that_say_too_little():
    rng = np.random.default_rng(0)
    truth, found = [], []
    for _image in range(400):
        truth.append([10, 10, 10, 20])
        right = rng.random() < 0.8
        found.append(([10, 10, 10, 20] if right else [60, 60, 10, 20], 0.3 + 0.1 * rng.random()))
    boxes, scores = zip(*found, strict=True)
    numbers = np.arange(400)
    seen = Looked(
        true_boxes(numbers, [1] * 400, truth),
        found_boxes(numbers, [1] * 400, boxes, scores),
        ({"flight": 1},) * 400,
    )
    use = score_use(seen, "flight")
    before, after = calibration_errors(seen, use)
    assert use.threshold <= 0.31
    assert before > 0.35
    assert after < 0.05
