"""Which seconds of which video saw a point: by the poses, and not through a hill."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.view.ground import Ground
from pipeline.view.poses import Flight, decoded, encoded
from pipeline.view.who_saw import footprint, who_saw

CAMERA = Camera(1000, 500, 500.0, 500.0, 500.0, 250.0)
#: looks straight down, the picture's top to the north
DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
#: looks east along the ground
EAST = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def ground(wall: bool = False) -> Ground:
    heights = np.zeros((400, 400), dtype=np.float32)
    if wall:
        heights[:, 210:212] = 30.0
    return Ground(LocalFrame(47.0, 8.0), -200.0, -200.0, 1.0, heights)


def flight(positions: np.ndarray, rotation: np.ndarray, times_s: np.ndarray, focal: float = 1.0) -> Flight:
    n = len(times_s)
    rotations = np.repeat(rotation[None], n, axis=0)
    videos = (("/a.mp4", 0.0), ("/b.mp4", 10.0))
    return Flight("one", "air", CAMERA, 0, videos, times_s, positions, rotations, np.full(n, focal))


def along_north(times_s: np.ndarray, height_m: float = 50.0) -> np.ndarray:
    return np.stack([np.zeros_like(times_s), 5.0 * times_s - 100.0, np.full_like(times_s, height_m)], axis=1)


@pytest.mark.parametrize(("focal", "half_m"), [(1.0, 24.5), (2.0, 12.25)])
def test_a_point_is_seen_while_it_is_in_the_picture(focal: float, half_m: float) -> None:
    times = np.arange(0.0, 40.0, 0.2)
    seen = who_saw([flight(along_north(times), DOWN, times, focal)], ground(), 0.0, 0.0)
    assert len(seen) == 1
    # at 5 m/s it is below the drone at 20 s; the picture reaches half_m to either side, 1 m above the ground
    assert seen[0].from_s == pytest.approx(20.0 - half_m / 5.0, abs=0.21)
    assert seen[0].to_s == pytest.approx(20.0 + half_m / 5.0, abs=0.21)
    assert seen[0].best_s == pytest.approx(20.0, abs=0.11)
    assert (seen[0].x, seen[0].y) == (500.0, pytest.approx(250.0, abs=12.0))


def test_a_drone_that_comes_back_has_two_stretches_and_one_beside_it_none() -> None:
    there = np.arange(0.0, 40.0, 0.2)
    times = np.concatenate([there, there + 40.0])
    way = np.concatenate([along_north(there), along_north(there)[::-1]])
    flown = flight(way, DOWN, times)
    seen = who_saw([flown], ground(), 0.0, 0.0)
    assert len(seen) == 2
    assert seen[0].to_s < 26.0
    assert seen[1].from_s > 54.0
    assert who_saw([flown], ground(), 60.0, 0.0) == ()


def test_nobody_sees_through_a_wall_or_beyond_the_map() -> None:
    times = np.arange(0.0, 4.0, 0.2)
    still = np.repeat(np.array([[-50.0, 0.0, 10.0]]), len(times), axis=0)
    looking = [flight(still, EAST, times)]
    assert who_saw(looking, ground(), 60.0, 0.0)
    assert who_saw(looking, ground(wall=True), 60.0, 0.0) == ()
    assert who_saw(looking, ground(wall=True), -10.0, 0.0)  # before the wall
    assert who_saw(looking, ground(), 5000.0, 0.0) == ()
    assert who_saw(looking, ground(), -150.0, 0.0) == ()  # behind the camera


def test_a_moment_of_the_stream_is_in_one_of_its_files() -> None:
    flown = flight(along_north(np.arange(3.0)), DOWN, np.arange(3.0))
    assert flown.video_at(9.0) == (0, 9.0)
    assert flown.video_at(12.5) == (1, 2.5)
    again = decoded(encoded([flown]))[0]
    assert again.videos == flown.videos
    assert np.allclose(again.positions, flown.positions)


def test_the_footprint_is_what_the_corners_see() -> None:
    flown = flight(along_north(np.array([20.0])), DOWN, np.array([20.0]))
    corners = footprint(flown, ground(), 0)
    assert np.allclose(corners, [[-50.0, 25.0], [50.0, 25.0], [50.0, -25.0], [-50.0, -25.0]])
    level = flight(along_north(np.array([20.0])), EAST, np.array([20.0]))
    assert np.isnan(footprint(level, ground(), 0)[:2]).all()  # above the horizon
