"""Under cover a look that found nobody says less, and one that found somebody as much as ever."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.fusion.voxel_map import VoxelMap
from pipeline.geo.frame import LocalFrame
from pipeline.geo.surfaces import plane

OPEN = plane(LocalFrame(47.0, 8.0), -8.0, -8.0, 8.0, 8.0, 0.5, 0.0)


def seen(hidden, log_odds, pod):
    cover = None if hidden is None else np.full(OPEN.shape, hidden, np.float32)
    voxels = VoxelMap(replace(OPEN, cover=cover), 0.1192, 0.971)
    cells = np.array([3]), np.array([4])
    voxels.update(*cells, np.array([log_odds]))
    voxels.tiles.cells["pod_before"][voxels.tiles.flat(*cells)] = pod
    return float(voxels.probability()[3, 4]), float(voxels.layer("pod")[3, 4])


def test_pod_is_that_of_people_who_can_be_seen_times_their_share():
    for hidden in (0.0, 0.25, 0.5, 1.0):
        assert seen(hidden, -1.0, 0.8)[1] == pytest.approx(0.8 * (1.0 - hidden), abs=1e-6)


def test_looks_that_found_nobody_leave_those_who_are_hidden():
    for hidden in (0.1, 0.5, 0.9):
        odds = hidden + (1.0 - hidden) * np.exp(-1.5)
        assert seen(hidden, -1.5, 0.5)[0] == pytest.approx(odds / (1.0 + odds), abs=1e-6)
    assert seen(1.0, -1.5, 0.5)[0] == pytest.approx(0.5, abs=1e-6)


def test_who_was_seen_is_not_hidden():
    assert seen(0.9, 1.5, 0.5)[0] == seen(None, 1.5, 0.5)[0]


def test_no_cover_changes_no_bit():
    assert seen(0.0, -1.5, 0.5) == pytest.approx(seen(None, -1.5, 0.5), abs=1e-7)
    assert seen(None, -1.5, 0.5)[0] == float(np.float32(1.0 / (1.0 + np.exp(np.float32(1.5)))))
