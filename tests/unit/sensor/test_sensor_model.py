import numpy as np
import pytest

from pipeline.sensor.model import (
    SMALLEST_BOX_PX,
    SensorModel,
    bbox_size_px,
    distance_factor,
    p_negative,
    p_positive,
    tukey_window,
)


def test_p_positive_by_hand():
    assert p_positive(0.5, 0.98, 0.8, 0.4) == pytest.approx(0.5 + 0.1568)


def test_p_positive_without_trust_says_nothing():
    assert p_positive(0.0, 1.0, 1.0, 0.5) == 0.5


def test_p_negative_by_hand():
    np.testing.assert_allclose(p_negative(np.array([0.0, 0.75]), 0.8, 0.1), [0.5, 0.44])


def test_box_size_by_hand():
    assert bbox_size_px(1.8, 20.0, 900.0, 1024.0, 1024.0) == pytest.approx(81.0)
    assert bbox_size_px(1.8, 20.0, 900.0, 512.0, 1024.0) == pytest.approx(40.5)


def test_distance_factor_falls_linearly_to_zero():
    np.testing.assert_allclose(
        distance_factor(np.array([0.0, 15.0, 60.0, 90.0]), 60.0), [1.0, 0.75, 0.0, 0.0]
    )


def test_tukey_window_of_alpha_zero_is_rectangular():
    assert [tukey_window(x, 0.0) for x in (-0.01, 0.0, 0.3, 1.0, 1.01)] == [0.0, 1.0, 1.0, 1.0, 0.0]


def test_tukey_window_of_alpha_one_is_hanns():
    x = np.linspace(0.0, 1.0, 101)
    np.testing.assert_allclose([tukey_window(v, 1.0) for v in x], np.sin(np.pi * x) ** 2, atol=1e-12)


def test_tukey_window_by_hand():
    # alpha 0.5: tapers on the outer quarters; 1/8 is half way up
    assert tukey_window(0.125, 0.5) == pytest.approx(0.5)
    assert tukey_window(0.25, 0.5) == pytest.approx(1.0)
    assert tukey_window(0.875, 0.5) == pytest.approx(0.5)
    assert tukey_window(0.0, 0.5) == 0.0


def test_area_component_by_hand(camera, params):
    # at 20 m: least 9 x 9 px, greatest 99 x 99 px; the middle of 81..9801 is 4941 px^2
    model = SensorModel(camera, params)
    assert model.area_component(np.array([100.0, 100.0, 161.0, 181.0]), 20.0) == pytest.approx(1.0)
    # 1/8 of the way: 81 + 1215 = 1296 = 36 x 36 px
    assert model.area_component(np.array([0.0, 0.0, 36.0, 36.0]), 20.0) == pytest.approx(0.5)


@pytest.mark.parametrize("side", [8.9, 99.1, 500.0])
def test_boxes_too_small_or_too_big_are_rejected(camera, params, side):
    box = np.array([10.0, 10.0, 10.0 + side, 10.0 + side])
    assert SensorModel(camera, params).positive(box, 1.0, 20.0, 1.0) == 0.5


def test_positive_by_hand(camera, params):
    box = np.array([0.0, 0.0, 36.0, 36.0])
    assert SensorModel(camera, params).positive(box, 0.8, 20.0, 0.5) == pytest.approx(
        0.5 + 0.5 * 0.5 * 0.8 * 0.4
    )


def test_max_distance_is_where_the_least_object_is_of_the_smallest_size(camera, params):
    model = SensorModel(camera, params)
    assert model.max_distance_m == pytest.approx(900.0 * 0.2 / SMALLEST_BOX_PX)
    assert model.reach_m == pytest.approx(900.0 * 2.2 / SMALLEST_BOX_PX)


def test_negative_by_hand(camera, params):
    model = SensorModel(camera, params)
    p = model.negative(np.array([0.0, model.max_distance_m / 2.0, 2.0 * model.max_distance_m]), 0.8)
    np.testing.assert_allclose(p, [0.42, 0.46, 0.5])
