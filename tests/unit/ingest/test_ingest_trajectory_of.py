"""What tells the angles, the heights and the clock of a flight; and that nothing is made up where nothing does."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from pipeline.config.telemetry import Angles, Telemetry
from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.ingest.clock import Alignment, on_the_videos_clock
from pipeline.ingest.telemetry.dji_srt import read_dji_srt
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory import Trajectory
from pipeline.ingest.trajectory_of import Ground, course, trajectory_of

FRAME = LocalFrame(59.0, 15.0)
GROUND = Ground("ellipsoid", lambda east, north: 50.0)
NONE = np.full(5, np.nan)
#: a camera that looks down along the course
ANGLED = {"gimbal": {"pitch": {"degrees": -45}, "yaw": "course"}}


def flight(**fields: object) -> Track:
    """Five seconds eastward at 2 m/s, 30 m above take-off, 100 m above the ellipsoid, no angles."""
    east = 2.0 * np.arange(5.0)
    latitude, longitude = FRAME.wgs84_from_enu(east, np.zeros(5))
    track = Track(
        10**18, np.arange(5.0), latitude, longitude, np.full(5, 100.0), np.full(5, 30.0), NONE, NONE, NONE
    )
    return replace(track, **fields)  # type: ignore[arg-type]


def way(track: Track, ground: Ground = GROUND, other: Track | None = None, **given: object) -> Trajectory:
    telemetry = Telemetry.model_validate({"file": "drone.srt", **given})
    return trajectory_of(track, telemetry, FRAME, ground, angles=other)


def yaw_deg(trajectory: Trajectory, time_s: float = 1.0) -> float:
    pose = trajectory.pose(time_s)
    assert pose is not None
    forward = pose.enu_from_camera[:, 2]
    return math.degrees(math.atan2(forward[0], forward[1]))


def test_without_angles_the_error_says_what_to_write() -> None:
    with pytest.raises(
        InputError,
        match=r"without gimbal yaw and pitch; .*telemetry.angles.*gimbal: \{yaw: course, pitch: \{degrees: -45\}\}",
    ):
        way(flight())
    with pytest.raises(InputError, match=r"without gimbal pitch; .*pitch: \{degrees: -45\}"):
        way(flight(), gimbal={"yaw": "course"})


def test_a_fixed_gimbal_may_look_along_the_course_the_nose_or_an_angle() -> None:
    down = {"pitch": {"degrees": -45}}
    assert yaw_deg(way(flight(), gimbal=down | {"yaw": "course"})) == pytest.approx(90.0, abs=0.1)
    assert yaw_deg(way(flight(), gimbal=down | {"yaw": {"degrees": 200}})) == pytest.approx(-160.0)
    nose = flight(aircraft_yaw_rad=np.radians(np.full(5, 30.0)))
    assert yaw_deg(way(nose, gimbal=down | {"yaw": "aircraft"})) == pytest.approx(30.0)
    assert yaw_deg(
        way(nose, gimbal=down | {"yaw": "aircraft"}, mounting={"yaw": {"degrees": -90}})
    ) == pytest.approx(-60)
    assert yaw_deg(way(nose, gimbal=down | {"yaw": "aircraft"}, yaw_offset={"degrees": 5})) == pytest.approx(
        35.0
    )
    with pytest.raises(InputError, match="without the aircraft's heading"):
        way(flight(), gimbal=down | {"yaw": "aircraft"})


def test_a_camera_fixed_to_the_airframe_leans_with_it() -> None:
    flat = np.zeros(5)
    leaning = flight(
        aircraft_yaw_rad=np.radians(np.full(5, 80.0)),
        aircraft_pitch_rad=flat,
        aircraft_roll_rad=flat + math.radians(20.0),
    )
    fixed = {"yaw": "aircraft", "pitch": "aircraft"}
    # straight down on an airframe whose right wing is 20 degrees down: it looks 20 degrees to the left, the north
    pose = way(leaning, gimbal=fixed, mounting={"pitch": {"degrees": -90}}, yaw_offset={"degrees": 10}).pose(
        1.0
    )
    assert pose is not None
    assert np.allclose(
        pose.enu_from_camera[:, 2], [0.0, math.sin(math.radians(20.0)), -math.cos(math.radians(20.0))]
    )
    with pytest.raises(InputError, match="without the aircraft's attitude"):
        way(flight(aircraft_yaw_rad=flat), gimbal=fixed)
    with pytest.raises(ValidationError, match="gimbal"):
        way(leaning, gimbal={"yaw": "course", "pitch": "aircraft"})


def test_a_course_is_less_sure_than_an_angle_and_says_so() -> None:
    trajectory = way(flight(), gimbal={"pitch": {"degrees": -45}, "yaw": "course"})
    pose = trajectory.pose(1.0)
    assert pose is not None
    assert pose.attitude_sd_rad == pytest.approx(math.radians(8.0))
    assert any("course" in text for text in trajectory.assumed)


def test_a_drone_that_hovers_keeps_its_course_though_its_fix_wanders() -> None:
    rng = np.random.default_rng(1)
    north = np.concatenate([np.arange(0.0, 20.0, 0.5), np.full(50, 19.5)])
    way_m = np.stack([np.zeros(90), north], axis=1) + rng.normal(0.0, 0.1, (90, 2))
    assert np.abs(np.degrees(course(way_m)))[2:].max() < 25.0
    assert np.isnan(course(np.zeros((4, 2)))).all()


def test_a_course_turns_through_north_the_shorter_way() -> None:
    heading = np.radians(np.linspace(-30.0, 30.0, 61))
    way_m = np.cumsum(np.stack([np.sin(heading), np.cos(heading)], axis=1), axis=0)
    assert np.degrees(course(way_m)) == pytest.approx(np.degrees(heading), abs=1.6)


def test_angles_of_another_file_are_taken_at_their_own_times() -> None:
    other = replace(flight(), times_s=np.arange(5.0) + 7.0, yaw_rad=np.radians([0.0, 10.0, 20.0, 30.0, 40.0]),
                    pitch_rad=np.full(5, -0.5), roll_rad=np.zeros(5))  # fmt: skip
    given = {"file": "gimbal.csv", "time_offset": {"seconds": -6.5}}
    shifted = on_the_videos_clock(other, Angles.model_validate(given), flight(), Alignment(0.0))
    trajectory = way(flight(), other=shifted, angles=given)
    assert yaw_deg(trajectory, 1.0) == pytest.approx(5.0)
    assert trajectory.pose(0.0) is None


def test_relative_heights_count_from_the_take_off_or_the_ground_under_the_first_sample() -> None:
    gimbal = {"pitch": {"degrees": -45}, "yaw": "course"}
    told = way(flight(), height="relative", takeoff_height={"meters": 70}, gimbal=gimbal)
    assumed = way(flight(), height="relative", gimbal=gimbal)
    assert (told.positions_enu[0, 2], assumed.positions_enu[0, 2]) == (100.0, 80.0)
    assert any("take-off at the ground under the first sample, 50.0 m" in text for text in assumed.assumed)
    with pytest.raises(InputError, match="no ground under the first sample"):
        way(flight(), Ground("ellipsoid", lambda e, n: math.nan), height="relative", gimbal=gimbal)


def test_a_take_off_that_is_assumed_is_as_unsure_as_the_ground_about_it_is_uneven() -> None:
    gimbal = {"pitch": {"degrees": -45}, "yaw": "course"}
    slope = Ground("ellipsoid", lambda east, north: 50.0 + 0.1 * east)
    pose = way(flight(), slope, height="relative", gimbal=gimbal).pose(1.0)
    assert pose is not None
    # a tenth of the east of points 25 and 50 m around: 2.5 / sqrt(2) and 5 / sqrt(2), root of the mean square
    assert pose.height_sd_m == pytest.approx(math.hypot(2.0, math.sqrt((3.125 + 12.5) / 2.0)))


def test_a_file_without_any_height_is_used_if_the_mission_says_one() -> None:
    bare = flight(absolute_height_m=NONE, relative_height_m=NONE)
    given = {"height": "relative", "gimbal": {"pitch": {"degrees": -45}, "yaw": "course"}}
    assert way(bare, flight_height={"meters": 40}, **given).positions_enu[0, 2] == 90.0
    with pytest.raises(InputError, match=r"without relative height; expected .*telemetry.flight_height"):
        way(bare, **given)
    with pytest.raises(InputError, match=r"without relative height; expected telemetry.height: absolute"):
        way(flight(relative_height_m=NONE), **given)


def test_the_geoid_model_is_asked_where_no_undulation_is_given_and_its_error_is_kept() -> None:
    ground = Ground("ellipsoid", lambda e, n: 0.0, lambda latitude, longitude: (25.0, 0.5))
    gimbal = {"pitch": {"degrees": -45}, "yaw": "course"}
    trajectory = way(flight(height_datum="geoid"), ground, gimbal=gimbal)
    pose = trajectory.pose(1.0)
    assert pose is not None
    assert pose.position_enu[2] == 125.0
    assert pose.height_sd_m == pytest.approx(math.hypot(2.0, 0.5))  # the mission's 2 m, and the model's
    told = way(flight(), ground, height_datum="geoid", geoid_undulation={"meters": 30}, gimbal=gimbal)
    assert told.positions_enu[0, 2] == 130.0
    assert any("count from the ellipsoid" in text for text in way(flight(), gimbal=gimbal).assumed)


def test_the_last_sample_holds_to_its_end_and_goes_on_as_it_moved() -> None:
    gimbal = {"pitch": {"degrees": -45}, "yaw": {"degrees": 0}}
    trajectory = way(flight(end_s=5.0), gimbal=gimbal)
    pose = trajectory.pose(5.0)
    assert pose is not None
    assert pose.position_enu[0] == pytest.approx(10.0, abs=1e-6)
    assert pose.horizontal_sd_m == pytest.approx(math.hypot(1.3, 1.0))  # the mission's 1.3 m, and half of 2 m
    assert trajectory.pose(5.1) is None
    np.testing.assert_allclose(
        pose.enu_from_camera, enu_from_camera(0.0, math.radians(-45.0), 0.0), atol=1e-12
    )


def test_there_is_no_pose_in_a_gap_that_is_too_long() -> None:
    gimbal = {"pitch": {"degrees": -45}, "yaw": {"degrees": 0}}
    gap = flight(times_s=np.array([0.0, 1.0, 2.0, 8.0, 9.0]))
    trajectory = way(gap, gimbal=gimbal)
    assert all(trajectory.pose(t) is not None for t in (2.0, 2.4, 7.6, 8.0))
    assert all(trajectory.pose(t) is None for t in (3.0, 5.0, 7.4))
    assert way(gap, gimbal=gimbal, longest_gap={"seconds": 7}).pose(5.0) is not None


def test_stated_standard_deviations_come_with_the_pose() -> None:
    gimbal = {"pitch": {"degrees": -45}, "yaw": {"degrees": 0}}
    stated = flight(horizontal_sd_m=np.array([1.0, 3.0, 3.0, 3.0, 3.0]), height_sd_m=np.full(5, 2.0))
    pose = way(stated, gimbal=gimbal).pose(0.5)
    assert pose is not None
    assert (pose.horizontal_sd_m, pose.height_sd_m) == (2.0, 2.0)
    assert math.isnan(pose.attitude_sd_rad)


def test_a_zoom_changes_the_focal_length_at_its_sample() -> None:
    gimbal = {"pitch": {"degrees": -45}, "yaw": {"degrees": 0}}
    trajectory = way(flight(focal_length_35mm=np.array([24.0, 24.0, 48.0, 48.0, 48.0])), gimbal=gimbal)
    scales = [pose.focal_scale for t in (0.0, 1.9, 2.0, 3.5) if (pose := trajectory.pose(t)) is not None]
    assert scales == [1.0, 1.0, 2.0, 2.0]


def test_the_clock_is_utc_only_where_the_offset_is_known() -> None:
    gimbal = {"pitch": {"degrees": -45}, "yaw": {"degrees": 0}}
    local = flight(clock="local")
    assert way(local, gimbal=gimbal).clock == "local"
    told = way(local, gimbal=gimbal, utc_offset={"hours": 2})
    assert (told.clock, told.utc_ns(0.0)) == ("utc", 10**18 - 7_200_000_000_000)


def test_a_position_that_is_missing_in_some_samples_costs_them_only() -> None:
    track = flight()
    latitude = track.latitude_deg.copy()
    latitude[2] = math.nan
    gimbal = {"pitch": {"degrees": -45}, "yaw": {"degrees": 0}}
    assert len(way(replace(track, latitude_deg=latitude), gimbal=gimbal).times_s) == 4
    with pytest.raises(InputError, match="without positions"):
        way(replace(track, latitude_deg=NONE), gimbal=gimbal)


def test_the_takeoff_is_where_the_heights_above_it_count_from() -> None:
    assert way(flight(), **ANGLED).takeoff_m == pytest.approx(
        70.0
    )  # 100 m above the ellipsoid, 30 m above it
    noisy = flight(relative_height_m=np.array([30.0, 30.2, 29.9, np.nan, 400.0]))
    assert way(noisy, **ANGLED).takeoff_m == pytest.approx(70.0, abs=0.2)


def test_the_takeoff_is_in_the_terrains_heights() -> None:
    relative = way(flight(), **ANGLED, height="relative")
    assert relative.takeoff_m == pytest.approx(50.0)  # assumed: the ground under the first sample
    assert way(
        flight(), **ANGLED, height="relative", takeoff_height={"meters": 43}
    ).takeoff_m == pytest.approx(43.0)
    geoid = Ground("ellipsoid", GROUND.height_m, lambda latitude, longitude: (40.0, 0.5))
    assert way(flight(), geoid, **ANGLED, height_datum="geoid").takeoff_m == pytest.approx(110.0)


def test_without_heights_above_it_nobody_knows_where_the_takeoff_was() -> None:
    assert math.isnan(way(flight(relative_height_m=NONE), **ANGLED).takeoff_m)


HOME20 = Path(__file__).resolve().parents[4] / "shared/data/cases/telemetry/home20.srt"


@pytest.mark.skipif(not HOME20.exists(), reason="no ../shared")
def test_a_drone_that_took_off_lower_than_it_films() -> None:
    frame = LocalFrame(58.4018, 15.5748)
    telemetry = Telemetry.model_validate({"file": str(HOME20), "height_datum": "ellipsoid"})
    trajectory = trajectory_of(read_dji_srt(HOME20), telemetry, frame, GROUND)
    assert trajectory.takeoff_m == pytest.approx(93.267, abs=0.02)


def test_heights_of_no_kind_tell_no_take_off_as_absolute_ones() -> None:
    either = flight(relative_height_m=np.full(5, 100.0))
    assert math.isnan(way(either, **ANGLED).takeoff_m)
    assert way(either, **ANGLED, height="relative").takeoff_m == pytest.approx(50.0)


def test_a_digital_zoom_alone_scales_the_camera_of_the_whole_picture() -> None:
    zoomed = flight(digital_zoom=np.array([1.0, 1.0, 2.0, 2.0, np.nan]))
    assert way(zoomed, **ANGLED).focal_scale.tolist() == [1.0, 1.0, 2.0, 2.0, 1.0]
