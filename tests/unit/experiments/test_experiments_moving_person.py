"""The trail of a person who walks past a hovering drone; the detector is exact, nothing is rendered."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.config.fusion import Fusion
from pipeline.experiments.moving_person import _trail
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, Detections

CAMERA = Camera(1024, 576, 900.0, 900.0, 512.0, 288.0)
POSE = CameraPose(np.array([0.0, -15.0, 15.0]), enu_from_camera(0.0, -np.pi / 4.0, 0.0))


def prepared():
    low, high = {"meters": 0.2}, {"meters": 2.2}
    fusion = Fusion.model_validate(
        {
            "cell_size": {"meters": 0.5}, "positive_max": 0.5, "negative_max": 0.1, "tukey_alpha": 0.5,
            "significant_point": "bottom_center", "threshold": 0.7, "cluster_distance": {"meters": 2},
            "lateness": {"seconds": 2},
            "object_size": {"width_min": low, "width_max": high, "height_min": low, "height_max": high},
        }
    )  # fmt: skip
    terrain = Terrain(LocalFrame(47.0, 8.0), -30.0, -30.0, 0.5, np.zeros((120, 120), dtype=np.float32))
    mission = SimpleNamespace(fusion=fusion, truth=None)
    return SimpleNamespace(
        mission=mission,
        terrain=terrain,
        frame=terrain.frame,
        cameras={"a": CAMERA},
        relative_accuracy={"d": 1.0},
    )


def walk():
    """Half a metre a second to the east, five frames a second."""
    for i in range(80):
        east = i / 10.0 - 4.0
        corners = np.array([[east + x, 0.0, z] for x in (-0.25, 0.25) for z in (0.0, 1.7)])
        pixels = CAMERA.project_enu(corners, POSE)
        box = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])[None]
        yield Detections(
            "a", "m:d", i, i * 200_000_000, POSE, box, np.array([0.9]), np.zeros(1, dtype=np.int64)
        )


@pytest.mark.parametrize(("negative_max", "oldest_s"), [(0.05, (5.0, 9.0)), (0.5, (0.2, 1.0))])
def test_the_trail_stays_with_a_slow_negative_update_and_goes_with_a_fast_one(negative_max, oldest_s):
    trail = _trail(prepared(), list(walk()), negative_max)
    assert oldest_s[0] <= trail.age_s.max() <= oldest_s[1]


def test_cells_left_five_seconds_ago_stand_or_do_not():
    slow, fast = (_trail(prepared(), list(walk()), value) for value in (0.05, 0.5))
    assert slow.left == fast.left > 5
    assert (slow.alive > 0.8 * slow.left, fast.alive) == (True, 0)
