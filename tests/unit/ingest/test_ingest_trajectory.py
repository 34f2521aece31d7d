"""The pose between samples, at the ends, and its height above each datum."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.config.telemetry import Telemetry
from pipeline.config.terrain import Datum
from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory import Trajectory
from pipeline.ingest.trajectory_of import Ground, trajectory_of
from pipeline.messages import CameraPose

FRAME = LocalFrame(59.0, 15.0)
FILE = Path("drone.srt")


def track(yaw_deg: tuple[float, float] = (0.0, 90.0)) -> Track:
    """Two samples, 1 s apart, 100 m north and 20 m up."""
    north = FRAME.wgs84_from_enu(np.array([0.0, 0.0]), np.array([0.0, 100.0]))
    zero = np.zeros(2)
    heights = np.array([100.0, 120.0])
    yaw_rad, pitch_rad = np.radians(yaw_deg), np.radians([-45.0, -45.0])
    return Track(10**18, np.array([0.0, 1.0]), *north, heights, heights - 90.0, yaw_rad, pitch_rad, zero)


def telemetry(**fields: object) -> Telemetry:
    return Telemetry.model_construct(
        **({"file": FILE} | Telemetry.model_construct(file=FILE).__dict__ | fields)
    )


def way(samples: Track, terrain_datum: Datum = "ellipsoid", **fields: object) -> Trajectory:
    return trajectory_of(
        samples, telemetry(**fields), FRAME, Ground(terrain_datum, lambda east, north: math.nan)
    )


def at(
    time_s: float, samples: Track | None = None, terrain_datum: Datum = "ellipsoid", **fields: object
) -> CameraPose:
    pose = way(track() if samples is None else samples, terrain_datum, **fields).pose(time_s)
    assert pose is not None
    return pose


def height_m(terrain_datum: str = "ellipsoid", **fields: object) -> float:
    return float(at(0.0, terrain_datum=terrain_datum, **fields).position_enu[2])  # type: ignore[arg-type]


def test_the_pose_between_two_samples_is_linear() -> None:
    pose = at(0.25)
    np.testing.assert_allclose(pose.position_enu, [0.0, 25.0, 105.0], atol=1e-3)
    np.testing.assert_allclose(
        pose.enu_from_camera, enu_from_camera(math.radians(22.5), math.radians(-45.0), 0.0), atol=1e-12
    )


@pytest.mark.parametrize(
    ("yaw_deg", "middle_deg"), [((170.0, -170.0), 180.0), ((350.0, 10.0), 0.0), ((10.0, -30.0), -10.0)]
)
def test_angles_turn_the_shorter_way(yaw_deg: tuple[float, float], middle_deg: float) -> None:
    pose = at(0.5, track(yaw_deg))
    expected = enu_from_camera(math.radians(middle_deg), math.radians(-45.0), 0.0)
    np.testing.assert_allclose(pose.enu_from_camera, expected, atol=1e-12)


def test_a_camera_that_swings_through_straight_down_does_not_spin() -> None:
    samples = replace(
        track((0.0, 180.0)), pitch_rad=np.radians([-89.0, -89.0]), roll_rad=np.radians([0.0, 180.0])
    )
    np.testing.assert_allclose(
        at(0.5, samples).enu_from_camera, enu_from_camera(0.0, -math.pi / 2.0, 0.0), atol=1e-9
    )


def test_a_drone_that_turns_over_its_place_turns_the_picture_of_what_is_below() -> None:
    samples = replace(track((350.0, 30.0)), pitch_rad=np.radians([-90.0, -90.0]))
    np.testing.assert_allclose(
        at(0.25, samples).enu_from_camera, enu_from_camera(0.0, -math.pi / 2.0, 0.0), atol=1e-9
    )


def test_the_ends_go_on_as_they_moved_for_half_a_sample_and_no_longer() -> None:
    assert at(1.5).position_enu[1] == pytest.approx(150.0, abs=1e-3)
    assert at(-0.5).position_enu[1] == pytest.approx(-50.0, abs=1e-3)
    still = way(track())
    assert still.pose(1.6) is None
    assert still.pose(-0.6) is None


def test_the_time_offset_is_added_to_the_telemetry() -> None:
    later = way(track(), time_offset=10.0)
    pose = later.pose(10.25)
    assert pose is not None
    assert pose.position_enu[1] == pytest.approx(25.0, abs=1e-3)
    assert later.utc_ns(10.25) == 10**18 + 250_000_000
    assert later.pose(0.25) is None


@pytest.mark.parametrize(
    ("fields", "terrain_datum", "expected_m"),
    [
        ({}, "ellipsoid", 100.0),
        ({"height_datum": "geoid"}, "geoid", 100.0),
        ({"height_datum": "geoid", "geoid_undulation": 25.0}, "ellipsoid", 125.0),
        ({"height_datum": "ellipsoid", "geoid_undulation": 25.0}, "geoid", 75.0),
        ({"height": "relative", "takeoff_height": 80.0}, "ellipsoid", 90.0),
        (
            {"height": "relative", "takeoff_height": 80.0, "height_datum": "geoid", "geoid_undulation": -3.0},
            "ellipsoid",
            87.0,
        ),
    ],
)
def test_the_height_is_above_the_terrains_datum(
    fields: dict[str, object], terrain_datum: str, expected_m: float
) -> None:
    assert height_m(terrain_datum, **fields) == pytest.approx(expected_m)


def test_heights_above_different_datums_need_the_undulation() -> None:
    with pytest.raises(
        InputError,
        match="heights above the geoid and a terrain above the ellipsoid; expected geoid_undulation",
    ):
        height_m(height_datum="geoid")


def test_a_height_that_the_telemetry_lacks_is_named() -> None:
    samples = track()
    bare = Track(
        0, samples.times_s, samples.latitude_deg, samples.longitude_deg, np.full(2, np.nan), np.full(2, 1.0),
        samples.yaw_rad, samples.pitch_rad, samples.roll_rad,
    )  # fmt: skip
    with pytest.raises(
        InputError, match=r"telemetry without absolute height; expected telemetry\.height: relative"
    ):
        at(0.0, bare)
