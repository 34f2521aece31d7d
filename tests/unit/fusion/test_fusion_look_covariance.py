"""The covariance of one look against brute force: move the camera, turn it, see where the ray meets the ground."""

import math

import numpy as np
import pytest

from pipeline.config.uncertainty import EXACT
from pipeline.fusion.look_covariance import look_covariances
from pipeline.geo.pose import enu_from_camera
from pipeline.messages import CameraPose

CAMERA = np.array([3.0, -4.0, 30.0])
ATTITUDE = enu_from_camera(math.radians(35.0), math.radians(-50.0), 0.0)
HIT = CAMERA + np.array([10.0, 22.0, -30.0])


def _pose(**stated):
    return CameraPose(CAMERA, ATTITUDE, **stated)


def _of(field, size, pose=None, focal_sd=0.0):
    uncertainty = EXACT.model_copy(update={field: size} if field else {})
    noise, total = look_covariances(HIT[None], pose or _pose(), uncertainty, 0.001, focal_sd)
    return noise[0], total[0]


def _on_ground(camera, ray):
    return (camera + ray * (HIT[2] - camera[2]) / ray[2])[:2]


def _scatter(draw):
    points = np.array([draw(np.random.default_rng([5, i])) for i in range(20_000)])
    return np.cov(points.T)


def _moved(rng, horizontal, vertical):
    moved = CAMERA + rng.normal(size=3) * (horizontal, horizontal, vertical)
    return _on_ground(moved, HIT - CAMERA)


def _turned(rng, sd_rad):
    ray = HIT - CAMERA
    return _on_ground(CAMERA, ray + np.cross(rng.normal(size=3) * sd_rad, ray))


@pytest.mark.parametrize(
    ("field", "size", "draw"),
    [
        ("position_noise", 0.1, lambda rng: _moved(rng, 0.1, 0.1)),
        ("position_bias", 0.1, lambda rng: _moved(rng, 0.1, 0.0)),
        ("height_bias", 0.1, lambda rng: _moved(rng, 0.0, 0.1)),
        ("terrain", 0.1, lambda rng: _moved(rng, 0.0, 0.1)),
        ("attitude_noise", 0.005, lambda rng: _turned(rng, 0.005)),
        ("attitude_bias", 0.005, lambda rng: _turned(rng, 0.005)),
        ("box", 5.0, lambda rng: _turned(rng, 0.005)),
    ],
)
def test_each_error_spreads_the_place_as_random_draws_of_it_do(field, size, draw):
    _, total = _of(field, size)
    np.testing.assert_allclose(total, _scatter(draw), rtol=0.05, atol=0.05 * np.trace(total))


def test_a_wrong_focal_length_moves_the_place_along_the_line_from_the_axis():
    ray = ATTITUDE.T @ (HIT - CAMERA)
    longer = ATTITUDE @ (ray * (1.0 / 1.001, 1.0 / 1.001, 1.0))
    shift = (_on_ground(CAMERA, longer) - HIT[:2]) / 0.001
    _, total = _of(None, 0.0, focal_sd=0.01)
    np.testing.assert_allclose(total, 0.01**2 * np.outer(shift, shift), rtol=0.02, atol=1e-4)


def test_only_what_differs_from_look_to_look_is_noise():
    for field in ("position_bias", "height_bias", "attitude_bias", "terrain", "body"):
        noise, total = _of(field, 0.02)
        assert not noise.any(), field
        assert total.any(), field
    for field in ("position_noise", "attitude_noise", "box"):
        noise, total = _of(field, 0.02)
        np.testing.assert_array_equal(noise, total)
        assert noise.any(), field


def test_what_the_pose_states_of_itself_takes_the_place_of_the_missions_bias():
    stated = _pose(horizontal_sd_m=0.02, height_sd_m=0.0, attitude_sd_rad=0.0)
    _, total = _of("position_bias", 1.3, pose=stated)
    np.testing.assert_allclose(total, np.eye(2) * 0.02**2)


def test_exact_is_exact():
    noise, total = _of(None, 0.0)
    assert not noise.any()
    assert not total.any()
