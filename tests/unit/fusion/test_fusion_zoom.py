"""A pose that says a longer focal length gives the map that a camera of that focal length gives."""

from dataclasses import replace

import numpy as np

from pipeline.config.fusion import Fusion
from pipeline.fusion.fuser import Fuser
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, Detections

TERRAIN = Terrain(LocalFrame(47.0, 8.0), -60.0, -20.0, 0.5, np.zeros((240, 240), np.float32))
POSE = CameraPose(np.array([0.0, 0.0, 20.0]), enu_from_camera(0.0, np.radians(-45.0), 0.0))


def odds(camera: Camera, params: Fusion, focal_scale: float) -> Fuser:
    fuser = Fuser(TERRAIN, params, {"v": camera}, {"d": 1.0})
    boxes = np.array([[500.0, 250.0, 530.0, 320.0], [100.0, 300.0, 130.0, 370.0]])
    for k in range(3):
        pose = replace(POSE, focal_scale=focal_scale)
        scores, classes = np.array([0.9, 0.8]), np.zeros(2, dtype=np.int64)
        fuser.apply(Detections("v", "d", k, 10**9 * k, pose, boxes, scores, classes))
    return fuser


def test_the_map_of_a_zoomed_pose_is_that_of_the_zoomed_camera(camera: Camera, params: Fusion) -> None:
    by_pose, by_camera = odds(camera, params, 2.0), odds(camera.zoomed(2.0), params, 1.0)
    usual = odds(camera, params, 1.0)
    assert [k.intersection_enu.tolist() for k in by_pose.looks] == [
        k.intersection_enu.tolist() for k in by_camera.looks
    ]
    assert [k.pixel_rad for k in by_pose.looks] == [k.pixel_rad for k in by_camera.looks]
    assert len(by_pose.looks) > 0
    assert [k.intersection_enu.tolist() for k in usual.looks] != [
        k.intersection_enu.tolist() for k in by_pose.looks
    ]
    np.testing.assert_array_equal(by_pose.map.log_odds, by_camera.map.log_odds)
    assert (usual.map.log_odds != by_pose.map.log_odds).any()
