"""The views that pictures are taken from."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.simulation.dataset import CAMERA, MISSION_VIEWS, TRAINING_VIEWS, pictures_of_scene, random_pose
from pipeline.simulation.ground import Extent
from pipeline.simulation.people import random_people
from pipeline.simulation.scene import build_scene


@pytest.fixture(scope="module")
def scene():
    place = build_scene(940001, Extent(60.0, 60.0), "mission")
    return place.with_people(random_people(np.random.default_rng(0), "mission", 9, place))


def test_mission_views_look_45_degrees_down_from_15_m_above_what_they_aim_at(scene):
    for seed in range(20):
        pose = random_pose(scene, MISSION_VIEWS, np.random.default_rng(seed))
        assert pose.enu_from_camera[2, 2] == pytest.approx(-np.sin(np.pi / 4))
        assert 8.0 < pose.position_enu[2] - scene.ground.base_m < 25.0


def test_training_views_stay_within_their_ranges_and_above_everything(scene):
    low, high = np.radians(TRAINING_VIEWS.pitch_deg)
    for seed in range(20):
        pose = random_pose(scene, TRAINING_VIEWS, np.random.default_rng(seed))
        assert np.sin(low) <= pose.enu_from_camera[2, 2] <= np.sin(high)
        east, north, up = pose.position_enu
        surface = scene.surface_height(np.array([east]), np.array([north]))[0]
        assert up > surface + 3.9


def test_most_views_have_a_person_in_the_picture(scene):
    feet = np.array(
        [
            [p.east_m, p.north_m, scene.ground.height(np.array([p.east_m]), np.array([p.north_m]))[0]]
            for p in scene.people
        ]
    )
    seen = 0
    for seed in range(30):
        pixels = CAMERA.project_enu(feet, random_pose(scene, MISSION_VIEWS, np.random.default_rng(seed)))
        seen += bool(((pixels >= 0) & (pixels <= [CAMERA.width, CAMERA.height])).all(axis=1).any())
    assert seen >= 20


@pytest.mark.slow
def test_the_same_seed_gives_the_same_picture():
    first, second = (next(pictures_of_scene(940001, "mission", 1, MISSION_VIEWS)) for _ in range(2))
    np.testing.assert_array_equal(first.image, second.image)
    np.testing.assert_array_equal(first.boxes_px, second.boxes_px)
