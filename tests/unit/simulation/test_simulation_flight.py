import math
from datetime import UTC, datetime

import numpy as np
import pytest

from pipeline.config.scenario import FlightPlan, PoseNoise
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.telemetry.dji_srt import read_dji_srt
from pipeline.simulation.flight import Flight, plan_flights
from pipeline.simulation.ground import Extent
from pipeline.simulation.pose_noise import disturbed, gauss_markov
from pipeline.simulation.srt_writer import dji_srt

CAMERA = Camera(1024, 576, 900.0, 900.0, 512.0, 288.0)
START = datetime(2026, 6, 14, 9, 30, tzinfo=UTC)


def plan(**changes):
    values = {
        "drones": 2,
        "height": {"meters": 15},
        "speed": {"meters_per_second": 3},
        "pitch": {"degrees": -45},
        "lane_spacing": {"meters": 15},
        "longest": {"minutes": 10},
    }
    return FlightPlan.model_validate(values | changes)


def flat(east, north):
    return np.full(np.broadcast(east, north).shape, 100.0)


AREA = Extent(60.0, 56.0)


def flights(extent=AREA, **changes):
    return plan_flights(plan(**changes), CAMERA, extent, 30.0, flat)


@pytest.mark.parametrize("drones", [1, 2, 3])
def test_every_place_of_the_area_is_seen(drones):
    extent = Extent(60.0, 56.0)
    east, north = (g.ravel() for g in np.meshgrid(np.linspace(-29, 29, 20), np.linspace(-27, 27, 20)))
    points = np.column_stack([east, north, np.full(400, 100.0)])
    frames = np.zeros(400, int)
    for flight in flights(extent, drones=drones):
        for i in range(0, len(flight.times_s), 15):
            x, y = CAMERA.project_enu(points, flight.pose(i)).T
            frames += (x > 0) & (x < 1024) & (y > 0) & (y < 576)
    assert frames.min() >= 3  # of one frame each half second


def test_the_speed_and_the_height_are_the_plan_s():
    for flight in flights():
        steps = np.linalg.norm(np.diff(flight.positions_enu, axis=0), axis=1) * 30.0
        assert steps == pytest.approx(3.0, rel=2e-3)
        assert flight.positions_enu[:, 2] == pytest.approx(115.0)


def test_the_camera_looks_along_the_flight():
    (flight,) = flights(drones=1)
    ahead = np.diff(flight.positions_enu, axis=0)
    wanted = np.arctan2(ahead[:, 0], ahead[:, 1])
    off = np.remainder(wanted - flight.angles_rad[:-1, 0] + math.pi, 2 * math.pi) - math.pi
    assert np.abs(off).max() < 0.02


def test_the_height_follows_the_ground_smoothly():
    def bumpy(east, north):
        return 100.0 + 0.05 * north + 2.0 * np.sin(2.0 * east) * np.sin(2.0 * north)

    for flight in plan_flights(plan(), CAMERA, Extent(60.0, 56.0), 30.0, bumpy):
        wanted = 115.0 + 0.05 * flight.positions_enu[:, 1]
        assert np.abs(flight.positions_enu[:, 2] - wanted).max() < 0.4


def test_the_longest_time_ends_a_flight():
    assert [len(f.times_s) for f in flights(longest={"seconds": 2})] == [60, 60]


def test_the_telemetry_is_read_back(tmp_path):
    flight, frame = flights()[1], LocalFrame(-33.94, 18.45)
    path = tmp_path / "drone.srt"
    path.write_text(dji_srt(flight, frame, START, 100.0))
    track = read_dji_srt(path)
    east, north = frame.enu_from_wgs84(track.latitude_deg, track.longitude_deg)
    assert np.column_stack([east, north, track.absolute_height_m]) == pytest.approx(
        flight.positions_enu, abs=0.001
    )
    assert track.relative_height_m == pytest.approx(15.0)
    turned = np.remainder(track.yaw_rad - flight.angles_rad[:, 0] + math.pi, 2 * math.pi) - math.pi
    assert turned == pytest.approx(0.0, abs=1e-5)
    assert track.pitch_rad == pytest.approx(flight.angles_rad[:, 1], abs=1e-5)
    assert track.times_s == pytest.approx(flight.times_s, abs=0.0006)
    assert track.start_time_ns == int(START.timestamp()) * 10**9


def noise(**changes):
    zero = {
        "position": {"meters": 0},
        "attitude": {"degrees": 0},
        "correlation_time": {"seconds": 2},
        "time_offset": {"seconds": 0},
    }
    return PoseNoise.model_validate(zero | changes)


def test_no_noise_changes_nothing():
    flight = flights()[0]
    told = disturbed(flight, noise(), np.random.default_rng(0))
    assert np.array_equal(told.positions_enu, flight.positions_enu)
    assert np.array_equal(told.angles_rad, flight.angles_rad)


def test_a_time_offset_tells_the_later_pose():
    flight = flights()[0]
    told = disturbed(flight, noise(time_offset={"seconds": 0.5}), np.random.default_rng(0))
    assert told.positions_enu[:-15] == pytest.approx(flight.positions_enu[15:])
    assert np.array_equal(told.times_s, flight.times_s)


def test_the_noise_has_the_deviation_and_the_correlation():
    times = np.arange(20_000) / 30.0
    values = gauss_markov(np.random.default_rng(0), times, 2.0, 4)
    assert values.std() == pytest.approx(1.0, abs=0.1)
    after_two_seconds = np.mean(values[:-60] * values[60:])
    assert after_two_seconds == pytest.approx(math.exp(-1.0), abs=0.1)


def test_the_focal_length_is_written_where_it_is_told_and_not_made_up_elsewhere(tmp_path):
    flight, frame = flights()[1], LocalFrame(-33.94, 18.45)
    path = tmp_path / "drone.srt"
    path.write_text(dji_srt(flight, frame, START, 100.0, 33.144))
    assert read_dji_srt(path).focal_length_35mm == pytest.approx(33.14)
    path.write_text(dji_srt(flight, frame, START, 100.0))
    focal_mm = read_dji_srt(path).focal_length_35mm
    assert focal_mm is None or np.isnan(focal_mm).all()


def test_one_frame_is_a_flight():
    flight = Flight(np.zeros(1), np.array([[0.0, 0.0, 115.0]]), np.zeros((1, 3)))
    assert dji_srt(flight, LocalFrame(58.0, 15.0), START, 100.0).startswith(
        "1\n00:00:00,000 --> 00:00:01,000\n"
    )


def test_a_hovering_drone_stays_where_it_is_and_looks_where_it_should():
    hover = {"east": {"meters": 3}, "north": {"meters": -15}, "heading": {"degrees": 90}}
    (flight,) = flights(drones=1, hover=hover, longest={"seconds": 4})
    assert len(flight.times_s) == 120
    assert np.ptp(flight.positions_enu, axis=0).max() == 0.0
    np.testing.assert_allclose(flight.positions_enu[0], [3.0, -15.0, 115.0])
    np.testing.assert_allclose(np.degrees(flight.angles_rad[0]), [90.0, -45.0, 0.0])


def test_only_one_drone_hovers():
    hover = {"east": {"meters": 0}, "north": {"meters": 0}, "heading": {"degrees": 0}}
    with pytest.raises(ValueError, match="mismatch"):
        plan(drones=2, hover=hover)
