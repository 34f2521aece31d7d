from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import expit, logit

from pipeline.config.pool import Calibration
from pipeline.sensor.calibration import calibrated, calibration_error, fit_calibration


def _boxes(scale, offset, count=40_000):
    """Scores, and which boxes are right, drawn with just the probability of that line."""
    rng = np.random.default_rng(3)
    scores = rng.uniform(0.3, 0.95, count)
    return scores, rng.uniform(size=count) < expit(scale * logit(scores) + offset)


@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (2.5, 1.5), (0.6, -0.4)])
def test_the_line_that_the_boxes_were_drawn_from_is_found(scale, offset):
    fitted = fit_calibration(*_boxes(scale, offset))
    assert fitted is not None
    assert (fitted.scale, fitted.offset) == pytest.approx((scale, offset), abs=0.06)


def test_calibrated_scores_are_right_as_often_as_they_say():
    scores, right = _boxes(2.5, 1.5)
    fitted = fit_calibration(scores, right)
    assert calibration_error(scores, right) > 0.1
    assert calibration_error(calibrated(scores, fitted), right) < 0.01


@given(st.floats(0.01, 10.0), st.floats(-5.0, 5.0), st.lists(st.floats(0.0, 1.0), min_size=2, max_size=20))
def test_calibration_keeps_the_order_and_stays_a_probability(scale, offset, scores):
    scores = np.sort(np.array(scores))
    worth = calibrated(scores, Calibration(scale=scale, offset=offset))
    assert (np.diff(worth) >= 0.0).all()
    assert ((worth >= 0.0) & (worth <= 1.0)).all()


def test_scores_that_part_right_from_wrong_get_a_finite_line():
    scores = np.array([0.2, 0.3, 0.7, 0.8])
    fitted = fit_calibration(scores, scores > 0.5)
    assert fitted is not None
    assert calibrated(scores, fitted)[[0, -1]] == pytest.approx([0.2, 0.8], abs=0.2)


@pytest.mark.parametrize("right", [[True, True], [False, False], [True, False]])
def test_scores_that_say_nothing_get_no_line(right):
    assert fit_calibration(np.array([0.4, 0.8]), np.array(right)) is None
    assert fit_calibration(np.zeros(0), np.zeros(0, bool)) is None


def test_the_expected_calibration_error_of_a_hand_computed_case():
    # bin of 0.9: two of four right, 0.4 too sure; bin of 0.1: none of one right, 0.1 too sure
    probabilities, right = np.array([0.9, 0.9, 0.9, 0.9, 0.1]), np.array([1, 1, 0, 0, 0], bool)
    assert calibration_error(probabilities, right) == pytest.approx((4 * 0.4 + 0.1) / 5)
