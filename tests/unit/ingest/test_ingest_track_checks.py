"""Samples alone: what no flight has is noticed, and what flights have is not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.telemetry import Telemetry
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.terrain import Terrain
from pipeline.ingest.checks.track_checks import (
    check_duration,
    check_sky,
    check_speed,
    check_takeoff,
    check_units,
)
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory import Trajectory
from pipeline.messages import FloatArray

CAMERA = Camera(640, 360, 560.0, 560.0, 320.0, 180.0)
FRAME = LocalFrame(47.0, 8.0)
TERRAIN = Terrain(FRAME, -400.0, -400.0, 4.0, np.full((200, 200), 500.0, np.float32))
TIMES_S = np.arange(0.0, 20.0, 0.5)
ONE = np.ones(len(TIMES_S))


def flight(speed_mps: float = 8.0, up_m: float = 530.0, pitch_deg: float = -45.0) -> Trajectory:
    position = np.stack([speed_mps * TIMES_S, 0.0 * ONE, up_m * ONE], axis=1)
    angles = np.radians(np.stack([90.0 * ONE, pitch_deg * ONE, 0.0 * ONE], axis=1))
    return Trajectory(TIMES_S, position, angles, np.full((len(ONE), 3), np.nan), ONE, 20.0, 3.0, 0, "utc")


def track(absolute_m: float = 530.0, relative_m: float = 30.0, pitch_deg: FloatArray | None = None) -> Track:
    pitch = np.radians(-45.0 * ONE if pitch_deg is None else pitch_deg)
    latitude, longitude = FRAME.wgs84_from_enu(8.0 * TIMES_S, 0.0 * ONE)
    return Track(
        0, TIMES_S, latitude, longitude, absolute_m * ONE, relative_m * ONE, ONE, pitch, 0.0 * ONE, "utc"
    )


@pytest.mark.parametrize("video_s", [19.0, 20.0, 25.0, 3600.0])
def test_telemetry_no_longer_than_the_video_is_believed(video_s: float) -> None:
    assert check_duration("a.srt", track(), video_s) == []


def test_telemetry_of_twice_the_video_is_noticed_and_a_log_of_the_whole_flight_is_not() -> None:
    (finding,) = check_duration("a.srt", track(), 10.0)
    assert finding.cause == "duration"
    assert "1.95 times" in finding.found
    assert check_duration("a.csv", replace(track(), tied_to_video=False), 5.0) == []


def test_angles_beyond_any_gimbal_are_units() -> None:
    (finding,) = check_units("a.csv", track(pitch_deg=-450.0 * ONE))
    assert finding.cause == "units"
    (finding,) = check_units("a.csv", replace(track(), left_out={"impossible": 100}))
    assert "100 samples impossible" in finding.evidence
    assert check_units("a.csv", track(pitch_deg=-90.5 * ONE)) == []
    assert check_units("a.csv", track(pitch_deg=math.nan * ONE)) == []


@pytest.mark.parametrize("speed_mps", [0.0, 8.0, 60.0])
def test_speeds_of_drones_and_aeroplanes_are_believed(speed_mps: float) -> None:
    assert check_speed("a.srt", flight(speed_mps)) == []


def test_a_jump_is_noticed_with_its_time() -> None:
    jumped = flight().positions_enu.copy()
    jumped[20:, 1] += 500.0
    (finding,) = check_speed("a.srt", replace(flight(), positions_enu=jumped))
    assert finding.cause == "jump"
    assert "at 9.0 s" in finding.found or "at 9.5 s" in finding.found


@pytest.mark.parametrize("pitch_deg", [-90.0, -45.0, -5.0, 0.0, 10.0])
def test_a_camera_with_ground_in_its_picture_is_believed(pitch_deg: float) -> None:
    assert check_sky("a.srt", flight(pitch_deg=pitch_deg), CAMERA) == []


@pytest.mark.parametrize("pitch_deg", [30.0, 45.0, 90.0])
def test_a_camera_that_sees_the_sky_only_is_noticed_even_while_it_hovers(pitch_deg: float) -> None:
    (finding,) = check_sky("a.srt", flight(0.0, pitch_deg=pitch_deg), CAMERA)
    assert finding.cause == "pitch_sign"
    assert f"{pitch_deg:+.0f} degrees" in finding.evidence


def test_some_pictures_of_the_sky_are_no_fault() -> None:
    angles = flight().angles_rad.copy()
    angles[: len(angles) // 3, 1] = math.radians(40.0)
    assert check_sky("a.srt", replace(flight(), angles_rad=angles), CAMERA) == []


def takeoff(absolute_m: float, relative_m: float = 30.0, undulation_m: float = 0.0) -> list[str]:
    told = Telemetry.model_validate({"file": "a.srt", "height": "absolute"})
    way = flight(up_m=absolute_m)
    found = check_takeoff("a.srt", track(absolute_m, relative_m), told, way, TERRAIN, undulation_m)
    return [f"{f.cause}: {f.found}; {f.evidence}" for f in found]


def test_a_take_off_on_the_ground_is_believed_and_one_in_the_air_or_below_is_not() -> None:
    assert takeoff(530.0) == []
    assert takeoff(533.0) == []
    (finding,) = takeoff(565.0)
    assert "height_off: take-off is +35.0 m" in finding
    (finding,) = takeoff(515.0)
    assert "-15.0 m" in finding


def test_an_offset_as_large_as_the_geoids_says_that_datums_may_be_mixed_up() -> None:
    (finding,) = takeoff(578.0, undulation_m=47.5)
    assert "datums may be mixed up" in finding
    (finding,) = takeoff(578.0, undulation_m=10.0)
    assert "datums" not in finding


def test_one_height_of_no_kind_tells_no_take_off_that_could_be_wrong() -> None:
    assert takeoff(530.0, 530.0) == []


def test_heights_in_feet_are_named() -> None:
    (finding,) = takeoff(530.0 / 0.3048, 30.0 / 0.3048)
    assert "in feet they would be right" in finding
