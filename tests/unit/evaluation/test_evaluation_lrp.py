from __future__ import annotations

import math

import numpy as np
import pytest

from pipeline.evaluation.metrics.boxes import found_boxes, true_boxes
from pipeline.evaluation.metrics.lrp import is_at_cutoff, lrp_curve, mean_optimal_lrp, optimal_lrp
from pipeline.evaluation.metrics.matching import match

TRUE = true_boxes([0, 1], [1, 1], [[0, 0, 10, 10], [0, 0, 10, 10]])


def optimum(true, found):
    return optimal_lrp(lrp_curve(match(true, found), 1))


def test_the_truth_itself_has_no_error():
    best = optimum(TRUE, found_boxes(TRUE.image, TRUE.category, TRUE.bbox, [0.9, 0.8]))
    assert (best.lrp, best.localisation, best.false_positive, best.false_negative) == (0, 0, 0, 0)
    assert best.threshold == 0.8


def test_nothing_found_is_the_greatest_error():
    best = optimum(TRUE, found_boxes([], [], [], []))
    assert (best.lrp, best.false_negative, best.threshold) == (1.0, 1.0, math.inf)
    assert math.isnan(best.localisation)
    assert math.isnan(best.false_positive)


def test_nothing_to_find_has_no_error_at_all():
    nobody = true_boxes([], [], [])
    assert math.isnan(optimum(nobody, found_boxes([0], [1], [[0, 0, 5, 5]], [0.9])).lrp)


def test_one_right_of_iou_eight_tenths_one_wrong_one_missed():
    found = found_boxes([0, 1], [1, 1], [[0, 0, 10, 8], [50, 0, 10, 10]], [0.9, 0.8])
    curve = lrp_curve(match(TRUE, found), 1)
    np.testing.assert_allclose(curve.threshold, [0.8, 0.9, np.inf])
    # (0.2 / 0.5 + wrong + missed) / (right + wrong + missed), Eq. lrp2
    np.testing.assert_allclose(curve.lrp, [(0.4 + 1 + 1) / 3, (0.4 + 1) / 2, 1.0], atol=1e-15)
    np.testing.assert_allclose(curve.false_positive[:2], [0.5, 0.0])
    np.testing.assert_allclose(curve.false_negative, [0.5, 0.5, 1.0])
    assert optimal_lrp(curve).threshold == 0.9


def test_a_crowd_is_neither_missed_nor_wrongly_found():
    crowd = true_boxes([0, 1], [1, 1], [[0, 0, 10, 10], [0, 0, 40, 40]], crowd=[False, True])
    found = found_boxes([0, 1, 1], [1, 1, 1], [[0, 0, 10, 10], [5, 5, 9, 9], [20, 20, 9, 9]], [0.9, 0.8, 0.7])
    assert optimum(crowd, found).lrp == 0.0


def test_the_mean_leaves_out_what_cannot_be_found():
    perfect = optimum(TRUE, found_boxes(TRUE.image, TRUE.category, TRUE.bbox, [0.9, 0.8]))
    nothing = optimum(true_boxes([], [], []), found_boxes([], [], [], []))
    assert mean_optimal_lrp([perfect, nothing]).lrp == 0.0
    assert math.isnan(mean_optimal_lrp([nothing]).lrp)


@pytest.mark.parametrize(
    ("threshold", "marked"), [(0.3, True), (0.3051, True), (0.32, False), (math.inf, False)]
)
def test_an_optimum_at_the_cutoff_is_marked(threshold, marked):
    assert is_at_cutoff(threshold, 0.3) is marked
