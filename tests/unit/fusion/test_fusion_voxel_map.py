import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.fusion.voxel_map import VoxelMap, log_odds
from pipeline.geo.frame import LocalFrame
from pipeline.geo.terrain import Terrain


def _map(clamp_min: float = 0.1192, clamp_max: float = 0.971) -> VoxelMap:
    heights = np.zeros((3, 4), dtype=np.float32)
    heights[2, 3] = np.nan
    return VoxelMap(Terrain(LocalFrame(47.0, 8.0), 0.0, 0.0, 1.0, heights), clamp_min, clamp_max)


def _update(voxel_map: VoxelMap, cells: list[tuple[int, int]], p: list[float]) -> None:
    rows, columns = np.array(cells, dtype=np.int64).T
    voxel_map.update(rows, columns, log_odds(np.array(p)))


def test_log_odds_of_known_values():
    np.testing.assert_allclose(log_odds(np.array([0.5, 0.75, 0.25])), [0.0, np.log(3.0), -np.log(3.0)])


def test_log_odds_are_finite_at_certainty():
    assert np.isfinite(log_odds(np.array([0.0, 1.0]))).all()


def test_evidence_adds_up():
    voxel_map = _map()
    _update(voxel_map, [(1, 2), (1, 2)], [0.6, 0.7])
    odds = 0.6 / 0.4 * 0.7 / 0.3
    assert voxel_map.probability()[1, 2] == pytest.approx(odds / (1.0 + odds), abs=1e-6)
    assert voxel_map.observations[1, 2] == 2


def test_a_voxel_never_leaves_the_clamping_limits():
    voxel_map = _map()
    _update(voxel_map, [(0, 0)] * 50 + [(0, 1)] * 50, [0.9] * 50 + [0.1] * 50)
    assert voxel_map.probability()[0, 0] == pytest.approx(0.971, abs=1e-6)
    assert voxel_map.probability()[0, 1] == pytest.approx(0.1192, abs=1e-6)


def test_clamping_acts_at_each_update_so_the_order_matters():
    voxel_map = _map()
    _update(voxel_map, [(0, 0)] * 3 + [(0, 1)] * 3, [0.97, 0.97, 0.3, 0.3, 0.97, 0.97])
    assert voxel_map.probability()[0, 0] < voxel_map.probability()[0, 1]


def test_a_certain_detection_can_be_taken_back_even_without_clamping_limits():
    voxel_map = _map(0.0, 1.0)
    _update(voxel_map, [(0, 0), (0, 0)], [1.0, 0.0])
    assert voxel_map.probability()[0, 0] == pytest.approx(0.5)


def test_unknown_is_one_half_and_no_voxel_is_nan():
    probability = _map().probability()
    assert probability.dtype == np.float32
    assert probability[0, 0] == 0.5
    assert np.isnan(probability[2, 3])


@pytest.mark.parametrize("cell", [(-1, 0), (0, -1), (3, 0), (0, 4), (2, 3)])
def test_a_cell_outside_or_of_unknown_height_is_no_voxel(cell):
    assert not _map().valid(*cell)
    assert _map().valid(2, 2)


@pytest.mark.parametrize("limits", [(0.6, 0.9), (0.1, 0.5), (-0.1, 0.9), (0.1, 1.1), (float("nan"), 0.9)])
def test_clamping_limits_that_do_not_hold_one_half_are_refused(limits):
    with pytest.raises(InputError, match="clamp_min"):
        _map(*limits)


def test_a_layer_can_not_be_written_to():
    with pytest.raises(ValueError, match="read-only"):
        _map().log_odds[0, 0] = 1.0


def test_the_probable_voxels_are_those_above_the_threshold_that_were_observed():
    heights = np.zeros((300, 600), dtype=np.float32)
    voxel_map = VoxelMap(Terrain(LocalFrame(47.0, 8.0), 0.0, 0.0, 1.0, heights), 0.1192, 0.971)
    cells = [(299, 3), (10, 599), (10, 2), (270, 300), (5, 5)]
    _update(voxel_map, cells, [0.9, 0.8, 0.9, 0.9, 0.3])
    rows, columns, p = voxel_map.probable(0.7)
    assert list(zip(rows, columns, strict=True)) == [(10, 2), (10, 599), (270, 300), (299, 3)]
    np.testing.assert_allclose(p, [0.9, 0.8, 0.9, 0.9], atol=1e-6)
    assert all(len(part) == 0 for part in voxel_map.probable(0.95))
