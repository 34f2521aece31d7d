from __future__ import annotations

import math

import pytest

from pipeline.sensor.expected_size import PERSON_HEIGHT_M, PERSON_WIDTH_M, expected_person_px


def test_straight_down_a_person_is_as_wide_as_long():
    expected = 900.0 * PERSON_WIDTH_M / 15.0
    assert expected_person_px(15.0, -math.pi / 2, 900.0) == pytest.approx(expected)


def test_aslant_the_box_is_that_of_a_projected_cylinder():
    distance = 15.0 / math.sin(math.radians(45))
    high = 900.0 / distance * (PERSON_HEIGHT_M + PERSON_WIDTH_M) * math.sqrt(0.5)
    wide = 900.0 / distance * PERSON_WIDTH_M
    assert expected_person_px(15.0, -math.radians(45), 900.0) == pytest.approx(math.sqrt(high * wide))


def test_twice_as_high_is_half_as_large():
    assert expected_person_px(30.0, -1.0, 900.0) == pytest.approx(expected_person_px(15.0, -1.0, 900.0) / 2)


@pytest.mark.parametrize(("height_m", "pitch_rad"), [(15.0, 0.0), (15.0, 0.3), (0.0, -0.5), (-2.0, -0.5)])
def test_where_no_ground_is_seen_nobody_is_expected(height_m, pitch_rad):
    assert expected_person_px(height_m, pitch_rad, 900.0) == 0.0
