from __future__ import annotations

import numpy as np
import pytest

from pipeline.training.accuracy import Seen, accuracy, people_by_size

BOXES = np.array([[10.0, 10.0, 40.0, 90.0], [100.0, 50.0, 160.0, 90.0]])


def seen(found, scores, visible=(1.0, 1.0)) -> Seen:
    return Seen(
        (320, 200), BOXES, np.array(visible), np.array(found, float).reshape(-1, 4), np.array(scores, float)
    )


def test_the_truth_itself_is_perfect():
    result = accuracy([seen(BOXES, [0.9, 0.8])])
    assert (result.ap, result.ap50, result.recall, result.precision) == pytest.approx((1.0, 1.0, 1.0, 1.0))
    assert result.bottom_edge_px == 0.0


def test_nothing_found_is_worth_nothing():
    result = accuracy([seen([], [])])
    assert (result.ap, result.recall, result.people) == (0.0, 0.0, 2)


def test_one_of_two_found_and_one_invented():
    result = accuracy([seen([BOXES[0] + [0, 0, 0, 4], [200, 100, 220, 150]], [0.8, 0.9])])
    assert result.recall == result.precision == 0.5
    assert result.ap50 == pytest.approx(0.25, abs=0.01)
    assert result.bottom_edge_px == 4.0


def test_hidden_people_are_neither_missed_nor_wrongly_found():
    for found in (BOXES[:1], BOXES):
        result = accuracy([seen(found, [0.9, 0.8][: len(found)], visible=(1.0, 0.1))])
        assert (result.people, result.recall, result.precision, result.ap50) == pytest.approx(
            (1, 1.0, 1.0, 1.0)
        )


def test_the_operating_point_leaves_out_what_costs_more_than_it_finds():
    wrong = [[200 + 10 * i, 100, 220 + 10 * i, 150] for i in range(5)]
    result = accuracy([seen([BOXES[0], *wrong, BOXES[1]], [0.9, 0.5, 0.5, 0.5, 0.5, 0.5, 0.2])])
    assert (result.score, result.recall, result.precision) == (0.9, 0.5, 1.0)


def test_the_average_precision_of_each_size_looks_at_people_of_that_size():
    small, large = np.array([0.0, 0.0, 20.0, 40.0]), np.array([50.0, 50.0, 170.0, 180.0])
    true = np.stack([small, large])
    result = accuracy([Seen((320, 200), true, np.ones(2), true[1:], np.array([0.9]))])
    assert (result.ap_small, result.ap_large) == pytest.approx((0.0, 1.0))
    assert np.isnan(result.ap_medium)


def test_people_are_counted_by_the_area_of_their_boxes():
    counted = people_by_size([seen([], []), seen([], [], visible=(1.0, 0.1))])
    assert counted == {"small": 0, "medium": 3, "large": 0}


def test_a_person_is_found_once():
    result = accuracy([seen([BOXES[0], BOXES[0], BOXES[1]], [0.9, 0.8, 0.7])])
    assert (result.recall, result.precision) == (1.0, pytest.approx(2 / 3))
