import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pipeline.fusion.voxel_map import VoxelMap, log_odds
from pipeline.geo.frame import LocalFrame
from pipeline.geo.terrain import Terrain
from pipeline.sensor.model import bbox_size_px, distance_factor, p_negative, p_positive, tukey_window

unit = st.floats(0.0, 1.0)
half = st.floats(0.0, 0.5)
positive = st.floats(0.01, 1e4)


@given(unit, unit, unit, half)
def test_a_detection_never_lowers_and_a_miss_never_raises(a, b, c, limit):
    assert 0.5 <= p_positive(a, b, c, limit) <= 1.0
    assert 0.0 <= p_negative(np.array([a]), b, limit)[0] <= 0.5


@given(st.floats(-2.0, 3.0), unit)
def test_the_window_is_symmetric_and_in_0_to_1(x, alpha):
    assert 0.0 <= tukey_window(x, alpha) <= 1.0
    if 0.01 < x < 0.99:
        assert abs(tukey_window(x, alpha) - tukey_window(1.0 - x, alpha)) < 1e-6


@given(positive, positive)
def test_the_distance_factor_is_in_0_to_1(distance, reach):
    assert 0.0 <= distance_factor(np.array([distance]), reach)[0] <= 1.0


@given(positive, positive, positive)
def test_solving_the_box_size_for_the_distance_is_its_inverse(size_m, distance_m, focal_px):
    box = bbox_size_px(size_m, distance_m, focal_px, 640.0, 1280.0)
    np.testing.assert_allclose(bbox_size_px(size_m, box, focal_px, 640.0, 1280.0), distance_m, rtol=1e-9)


@given(st.lists(unit, max_size=30))
def test_the_map_stays_between_its_limits(probabilities):
    voxel_map = VoxelMap(
        Terrain(LocalFrame(0.0, 0.0), 0.0, 0.0, 1.0, np.zeros((1, 1), np.float32)), 0.1192, 0.971
    )
    zero = np.zeros(len(probabilities), dtype=np.int64)
    voxel_map.update(zero, zero, log_odds(np.array(probabilities)))
    assert 0.1192 - 1e-6 <= voxel_map.probability()[0, 0] <= 0.971 + 1e-6
    assert voxel_map.observations[0, 0] == len(probabilities)
