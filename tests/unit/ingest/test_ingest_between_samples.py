"""How far a pose between two samples may be off: nothing where motion is even, and no less than it is in flight."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.geo.pose import enu_from_camera
from pipeline.ingest.between_samples import _turns, between_samples
from pipeline.ingest.trajectory import Trajectory
from pipeline.messages import FloatArray

#: the true flight's samples a second, and for how long it flies
RATE_HZ, LENGTH_S = 50, 120


def trajectory(times_s: FloatArray, positions: FloatArray, angles: FloatArray) -> Trajectory:
    return Trajectory(
        times_s,
        positions,
        angles,
        np.full((len(times_s), 3), math.nan),
        np.ones(len(times_s)),
        float(times_s[-1]),
        3.0,
        0,
        "utc",
        mission_sds=np.zeros(3),
    )


def flown(seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A flight of legs: straight ahead, then a turn on the spot or a halt, at moments that no sample knows."""
    rng = np.random.default_rng(seed)
    times = np.arange(LENGTH_S * RATE_HZ) / RATE_HZ
    speed, yaw_rate, pitch_rate = np.zeros_like(times), np.zeros_like(times), np.zeros_like(times)
    at = 0.0
    while at < LENGTH_S:
        lasts = rng.uniform(2.0, 8.0)
        now = (times >= at) & (times < at + lasts)
        speed[now] = rng.choice([0.0, 3.0, 8.0])
        turn_s = rng.uniform(0.3, 2.0)
        turning = (times >= at + lasts) & (times < at + lasts + turn_s)
        yaw_rate[turning] = rng.uniform(-90.0, 90.0) / turn_s
        pitch_rate[turning] = rng.uniform(-10.0, 10.0) / turn_s
        at += lasts + turn_s
    # a drone takes about a second to change its speed
    speed = np.convolve(
        np.pad(speed, (RATE_HZ, 0), mode="edge"), np.full(RATE_HZ + 1, 1.0 / (RATE_HZ + 1)), "valid"
    )
    yaw = np.radians(np.cumsum(yaw_rate) / RATE_HZ)
    pitch = np.radians(np.clip(-50.0 + np.cumsum(pitch_rate) / RATE_HZ, -85.0, -20.0))
    positions = (
        np.cumsum(np.stack([speed * np.sin(yaw), speed * np.cos(yaw), 0.1 * speed], axis=1), axis=0) / RATE_HZ
    )
    return times, positions, np.stack([yaw, pitch, np.zeros_like(yaw)], axis=1)


@pytest.mark.parametrize("rate_hz", [1, 2, 5])
def test_what_is_stated_covers_the_error_between_samples_in_19_of_20_cases(rate_hz: int) -> None:
    place_off, turn_off, place_sd, turn_sd = [], [], [], []
    for seed in range(101, 106):
        times, positions, angles = flown(seed)
        step = RATE_HZ // rate_hz
        sampled = trajectory(times[::step], positions[::step], angles[::step])
        for k in range(RATE_HZ, len(times) - RATE_HZ, 7):
            pose = sampled.pose(float(times[k]))
            assert pose is not None
            place_off.append(np.hypot(*(pose.position_enu - positions[k])[:2]))
            turn = Rotation.from_matrix(pose.enu_from_camera.T @ enu_from_camera(*angles[k])).magnitude()
            turn_off.append(turn)
            place_sd.append(np.nan_to_num(pose.horizontal_sd_m))
            turn_sd.append(np.nan_to_num(pose.attitude_sd_rad))
    for off, sd, exact in ((place_off, place_sd, 0.02), (turn_off, turn_sd, 0.003)):
        wrong = np.array(off) > exact
        assert wrong.mean() > 0.02  # there is something to be covered
        assert np.mean(np.array(off)[wrong] <= 2.0 * np.array(sd)[wrong]) >= 0.95


def test_even_motion_adds_nothing_at_any_rate_of_samples() -> None:
    times = np.array([0.0, 1.0, 2.5, 3.0, 4.7, 6.0])
    positions = times[:, None] * (3.0, -2.0, 0.5)
    angles = times[:, None] * (0.2, 0.0, 0.0) + (3.0, -0.8, 0.0)
    changes = between_samples(times, positions, angles, 3.0)
    assert np.abs(changes.before).max() < 1e-9
    assert np.abs(changes.after).max() < 1e-9


def test_a_halt_between_two_samples_is_known_at_both_of_them_and_not_between() -> None:
    times = np.arange(6.0)
    positions = np.zeros((6, 3))
    positions[:, 0] = [0.0, 4.0, 8.0, 10.0, 10.0, 10.0]
    sampled = trajectory(times, positions, np.zeros((6, 3)))
    sds = [np.nan_to_num(pose.horizontal_sd_m) for t in (2.0, 2.5, 3.0, 4.5) if (pose := sampled.pose(t))]
    assert sds[0] == 0.0
    assert sds[1] == pytest.approx(0.25 * 2.0)
    assert sds[2] == 0.0
    assert sds[3] == 0.0


def test_motion_across_a_gap_says_nothing_of_what_lies_beside_it() -> None:
    times = np.array([0.0, 1.0, 21.0, 22.0])
    positions = np.zeros((4, 3))
    positions[2:, 0] = 500.0
    changes = between_samples(times, positions, np.zeros((4, 3)), 3.0)
    assert changes.before[2, 0] == 0.0
    assert changes.after[0, 0] == 0.0


def test_turns_are_those_of_the_camera_also_where_it_looks_straight_down() -> None:
    rng = np.random.default_rng(3)
    angles = rng.uniform((-3.0, -1.57, -0.5), (3.0, 0.5, 0.5), (50, 3))
    attitudes = [enu_from_camera(*one) for one in angles.tolist()]
    sizes = [Rotation.from_matrix(a.T @ b).magnitude() for a, b in itertools.pairwise(attitudes)]
    np.testing.assert_allclose(np.linalg.norm(_turns(angles), axis=1), sizes, atol=1e-9)
    half_turns = np.radians([[0.0, -90.0, 0.0], [180.0, -90.0, 180.0]])
    assert np.linalg.norm(_turns(half_turns)) < 1e-9
