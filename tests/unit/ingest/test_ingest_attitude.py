"""Attitudes: against the rotation of ``pipeline.geo.pose``, which the map uses."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.geo.pose import enu_from_camera
from pipeline.ingest.attitude import Attitudes, angles_of_quaternions, camera_on_aircraft
from tests.dialects.attitudes import quaternion, relative_angles

YAWS = st.floats(-math.pi, math.pi)
PITCHES = st.floats(-1.4, 1.4)
ANGLES = st.tuples(YAWS, PITCHES, YAWS)


@given(ANGLES, st.tuples(YAWS, st.floats(-0.5, 0.5), st.floats(-0.7, 0.7)))
def test_a_camera_on_an_aircraft_looks_where_the_camera_model_says(
    camera: tuple[float, float, float], aircraft: tuple[float, float, float]
) -> None:
    relative = np.array([relative_angles(camera, aircraft)])
    back = camera_on_aircraft(np.array([aircraft]), relative)[0]
    assert np.allclose(enu_from_camera(*back), enu_from_camera(*camera), atol=1e-9)


def test_relative_angles_by_hand() -> None:
    heading = math.radians(90.0)
    # level aircraft flying east, camera turned 90 degrees to the right and 45 down: looks south and down
    back = camera_on_aircraft(np.array([[heading, 0.0, 0.0]]), np.radians([[90.0, -45.0, 0.0]]))
    assert np.allclose(np.degrees(back), [[180.0, -45.0, 0.0]])
    # right wing 30 degrees down, camera turned to the right wing: it looks 30 degrees down
    back = camera_on_aircraft(np.radians([[0.0, 0.0, 30.0]]), np.radians([[90.0, 0.0, 0.0]]))
    assert np.allclose(np.degrees(back), [[90.0, -30.0, 0.0]])
    # nose 10 degrees up, camera straight ahead and 60 down on the aircraft: 50 down from the horizon
    back = camera_on_aircraft(np.radians([[0.0, 10.0, 0.0]]), np.radians([[0.0, -60.0, 0.0]]))
    assert np.allclose(np.degrees(back), [[0.0, -50.0, 0.0]])


@given(ANGLES)
def test_a_quaternion_gives_its_angles_back(angles: tuple[float, float, float]) -> None:
    back = angles_of_quaternions(np.array([quaternion(*angles)]))[0]
    assert np.allclose(enu_from_camera(*back), enu_from_camera(*angles), atol=1e-9)


@pytest.mark.parametrize("wrong", [(0.0, 0.0, 0.0, 0.0), (math.nan, 0.0, 0.0, 1.0), (9e9, 0.0, 0.0, 0.0)])
def test_what_is_no_rotation_has_no_angles(wrong: tuple[float, ...]) -> None:
    assert np.isnan(angles_of_quaternions(np.array([wrong]))).all()


def test_between_samples_angles_turn_the_shorter_way_and_never_over_a_gap() -> None:
    own = Attitudes(
        np.array([0.0, 1.0, 5.0]), np.radians([[170.0, 0.0, 0.0], [-170.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    )
    yaw = np.degrees(own.at(np.array([-0.1, 0.0, 0.5, 1.0, 3.0, 5.0, 5.1]), longest_gap_s=2.0)[:, 0])
    assert np.isnan(yaw[[0, 4, 6]]).all()
    assert np.allclose(np.abs(yaw[[1, 2, 3, 5]]), [170.0, 180.0, 170.0, 0.0])


def test_a_camera_that_swings_through_straight_down_does_not_spin_between_samples() -> None:
    own = Attitudes(np.array([0.0, 1.0]), np.radians([[0.0, -89.0, 0.0], [180.0, -89.0, 180.0]]))
    between = own.at(np.array([0.5]), 2.0)[0]
    assert np.allclose(enu_from_camera(*between), enu_from_camera(0.0, -math.pi / 2, 0.0), atol=1e-9)


def test_unknown_and_repeated_attitudes_are_left_out() -> None:
    times = np.array([0.0, 0.0, 1.0, 2.0])
    own = Attitudes(times, np.array([[0.1, 0, 0], [0.9, 0, 0], [math.nan, 0, 0], [0.3, 0, 0]])).ordered()
    assert own.times_s.tolist() == [0.0, 2.0]
    assert np.allclose(Attitudes(times[:1], np.zeros((1, 3))).at(np.array([0.0, 1.0]), 1.0)[0], 0.0)
    assert np.isnan(Attitudes(times[:0], np.zeros((0, 3))).at(np.array([0.0]), 1.0)).all()
