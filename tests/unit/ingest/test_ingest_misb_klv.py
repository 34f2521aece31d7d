"""MISB ST 0601: what a writer of its own lays in comes out; damage costs the packet; tag 18 is judged."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.geo.pose import enu_from_camera
from pipeline.ingest.registry import format_of, read_telemetry
from pipeline.ingest.telemetry.misb_azimuth import azimuth_reading
from pipeline.ingest.track import Track
from tests.dialects import klv
from tests.dialects.tracks import START_NS, flight

DAY_FLIGHT = Path(__file__).parents[4] / "shared/data/telemetry/day_flight.klv"


def read(path: Path, **kept: Any) -> Track:
    return read_telemetry(Telemetry(file=path, **kept))


def assert_same_flight(track: Track, true: Track) -> None:
    assert np.allclose(track.latitude_deg, true.latitude_deg, atol=1e-7)
    assert np.allclose(track.longitude_deg, true.longitude_deg, atol=1e-7)
    assert np.allclose(track.absolute_height_m, true.absolute_height_m, atol=0.16)  # 2 bytes over 19,900 m
    for i in range(len(true.times_s)):
        one, other = (enu_from_camera(t.yaw_rad[i], t.pitch_rad[i], t.roll_rad[i]) for t in (track, true))
        assert np.allclose(one, other, atol=2e-3), i  # headings have 0.005 degrees, rolls 0.0015


@pytest.mark.parametrize("ellipsoid", [False, True])
def test_what_was_laid_in_comes_out(tmp_path: Path, ellipsoid: bool) -> None:
    path, true = tmp_path / "flight.klv", flight()
    klv.write(path, true, ellipsoid=ellipsoid)
    track = read(path)
    assert format_of(Telemetry(file=path)).name == "misb-klv"
    assert track.height_datum == ("ellipsoid" if ellipsoid else "geoid")
    assert (track.clock, track.start_time_ns, track.tied_to_video) == ("utc", START_NS, False)
    assert not track.left_out
    assert not track.assumed
    assert np.allclose(track.times_s, true.times_s, atol=1e-5)
    assert_same_flight(track, true)
    assert track.aircraft_yaw_rad is not None


#: tag, bytes, value: the examples that MISB ST 0601 itself prints
PRINTED = (
    (5, "71c2", 159.9744), (6, "fd3d", -0.4315251), (7, "08b8", 3.405814), (13, "5595b66d", 60.17682296697),
    (14, "5b5360c4", 128.42675904204), (15, "c221", 14190.72), (16, "cd9c", 144.5713),
    (18, "724a0a20", 160.71921147), (19, "87f84b86", -168.79232483), (20, "7dc55ece", 176.86543764),
)  # fmt: skip


def test_the_examples_of_the_standard_are_read_to_their_values(tmp_path: Path) -> None:
    path = tmp_path / "flight.klv"
    items = b"".join(bytes([tag, len(data) // 2]) + bytes.fromhex(data) for tag, data, _ in PRINTED)
    path.write_bytes(klv.packet(START_NS // 1000, {}, items))
    track = read(path, sensor_azimuth="absolute")
    value = {tag: value for tag, _, value in PRINTED}
    assert track.aircraft_yaw_rad is not None
    assert track.aircraft_pitch_rad is not None
    assert track.aircraft_roll_rad is not None
    assert track.focal_length_35mm is not None
    aircraft = (track.aircraft_yaw_rad, track.aircraft_pitch_rad, track.aircraft_roll_rad)
    for column, tag in zip(aircraft, (5, 6, 7), strict=True):
        assert math.degrees(column[0]) == pytest.approx(value[tag], abs=1e-4), tag
    # an elevation of -168.8 degrees is past straight down
    camera = enu_from_camera(*(math.radians(value[tag]) for tag in (18, 19, 20)))
    back = enu_from_camera(track.yaw_rad[0], track.pitch_rad[0], track.roll_rad[0])
    assert np.allclose(back, camera, atol=1e-9)
    assert abs(track.pitch_rad[0]) < math.pi / 2.0
    assert track.latitude_deg[0] == pytest.approx(value[13], abs=1e-9)
    assert track.longitude_deg[0] == pytest.approx(value[14], abs=1e-9)
    assert track.absolute_height_m[0] == pytest.approx(value[15], abs=0.01)
    assert 2.0 * math.degrees(math.atan(18.0 / track.focal_length_35mm[0])) == pytest.approx(
        value[16], abs=1e-4
    )


def test_angles_from_north_are_noticed_and_said(tmp_path: Path) -> None:
    path, true = tmp_path / "flight.bin", flight()
    klv.write(path, true, absolute=True)
    track = read(path)
    assert_same_flight(track, true)
    assert len(track.assumed) == 1
    assert "count from north" in track.assumed[0]


@pytest.mark.parametrize(
    ("heading_deg", "bearing_deg", "reading"),
    [
        (4.0, 50.0, "absolute"),  # nearly north: both readings fit, one is exact
        (4.0, 54.0, "relative"),
        (0.5, 50.0, "relative"),  # both are as good as a compass
        (4.0, 51.9, "relative"),  # between both: the standard
        (90.0, 136.0, "relative"),  # 4 degrees off
        (90.0, 46.0, "absolute"),
    ],
)
def test_the_reading_that_fits_is_taken(heading_deg: float, bearing_deg: float, reading: str) -> None:
    bearing = math.radians(bearing_deg)
    centre = [
        58.0 + 0.01 * math.cos(bearing),
        15.0 + 0.01 * math.sin(bearing) / math.cos(math.radians(58.0)),
        0.0,
    ]
    found = azimuth_reading(
        "x.klv", None, np.radians([[heading_deg, 0.0, 0.0]]), np.radians([[50.0, -10.0, 0.0]]),
        np.array([[58.0, 15.0, 200.0]]), np.array([centre]), [],
    )  # fmt: skip
    assert found == reading


@pytest.mark.parametrize(("stated", "absolute"), [("absolute", True), ("relative", False)])
def test_the_mission_may_say_what_angles_count_from(tmp_path: Path, stated: str, absolute: bool) -> None:
    path, true = tmp_path / "flight.klv", flight()
    klv.write(path, true, absolute=absolute, ground_m=None)
    track = read(path, sensor_azimuth=stated)
    assert_same_flight(track, true)
    assert not track.assumed


def test_without_a_frame_centre_the_standard_is_assumed_and_said(tmp_path: Path) -> None:
    path, true = tmp_path / "flight.klv", flight()
    klv.write(path, true, ground_m=None)
    track = read(path)
    assert_same_flight(track, true)
    assert "ST 0601" in track.assumed[0]


def test_a_frame_centre_that_fits_neither_reading_names_the_key(tmp_path: Path) -> None:
    path, true = tmp_path / "flight.klv", flight()
    whole = klv.packets(true)
    # the frame centres of a camera that looks to the other side
    turned = flight()
    turned.yaw_rad[:] += math.radians(100.0)
    centres = [klv.packet(0, {}) for _ in whole]
    data = b""
    for i, _ in enumerate(centres):
        wrong = _centre(turned, i)
        data += klv.packet(START_NS // 1000 + i * 100_000, _values(true, i) | wrong)
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"telemetry\.sensor_azimuth"):
        read(path)
    assert len(read(path, sensor_azimuth="relative").times_s) == len(whole)


def _values(track: Track, i: int) -> dict[int, float]:
    return {
        5: 40.0, 6: 2.0, 7: 1.0, 13: track.latitude_deg[i], 14: track.longitude_deg[i], 15: 120.0,
        18: 20.0, 19: -30.0, 20: 0.0,
    }  # fmt: skip


def _centre(track: Track, i: int) -> dict[int, float]:
    bearing = math.radians(200.0)
    return {
        23: track.latitude_deg[i] + 0.002 * math.cos(bearing),
        24: track.longitude_deg[i] + 0.004 * math.sin(bearing),
        25: 20.0,
    }


def test_a_wrong_checksum_costs_its_packet(tmp_path: Path) -> None:
    path, true = tmp_path / "flight.klv", flight()
    whole = klv.packets(true)
    damaged = bytearray(whole[20])
    damaged[40] ^= 0x10
    path.write_bytes(b"".join([*whole[:20], bytes(damaged), *whole[21:]]))
    track = read(path)
    assert track.left_out == {"checksum": 1}
    assert "packet 21" in track.first_left_out["checksum"]
    assert len(track.times_s) == len(whole) - 1
    assert 2.0 not in np.round(track.times_s, 3)


def test_a_damaged_length_does_not_take_the_packets_behind_it(tmp_path: Path) -> None:
    path, whole = tmp_path / "flight.klv", klv.packets(flight())
    damaged = bytearray(whole[10])
    damaged[16] ^= 0x40
    path.write_bytes(b"noise" + b"".join([*whole[:10], bytes(damaged), *whole[11:]]) + b"\x06\x0e\x2b")
    track = read(path)
    assert len(track.times_s) == len(whole) - 1
    assert sum(track.left_out.values()) == 1


@pytest.mark.parametrize("share", [0.31, 0.512, 0.907])
def test_a_file_cut_off_gives_what_is_whole(tmp_path: Path, share: float) -> None:
    path, whole = tmp_path / "flight.klv", klv.packets(flight())
    data = b"".join(whole)
    path.write_bytes(data[: int(share * len(data))])
    track = read(path)
    assert len(track.times_s) == int(int(share * len(data)) / len(whole[0]))
    assert track.left_out == {"cut_off": 1}


def test_long_lengths_long_tags_and_nested_sets_are_stepped_over(tmp_path: Path) -> None:
    path, true = tmp_path / "flight.klv", flight(3)
    security = bytes([48, 6, 1, 1, 1, 2, 1, 5])  # ST 0102: nested items 1 and 2
    targets = bytes([74, 4, 4, 2, 0, 9])  # ST 0903
    far = klv.ber_oid(142) + bytes([2, 7, 7])
    data = b""
    for i in range(3):
        values = _values(true, i)
        data += klv.packet(START_NS // 1000 + i * 100_000, values, security + targets + far, long_form=True)
    path.write_bytes(data)
    track = read(path)
    assert len(track.times_s) == 3
    assert np.allclose(track.latitude_deg, true.latitude_deg, atol=1e-7)


def test_full_range_attitude_and_focal_length(tmp_path: Path) -> None:
    path, true = tmp_path / "flight.klv", flight(3)
    data = b""
    for i in range(3):
        values = _values(true, i) | {90: 35.0, 91: -60.0, 16: 53.13}
        data += klv.packet(
            START_NS // 1000 + i * 100_000, {k: v for k, v in values.items() if k not in (6, 7)}
        )
    path.write_bytes(data)
    track = read(path)
    assert track.aircraft_pitch_rad is not None
    assert track.focal_length_35mm is not None
    assert np.allclose(np.degrees(track.aircraft_pitch_rad), 35.0, atol=1e-4)
    assert np.allclose(track.focal_length_35mm, 36.0, atol=0.01)


def test_without_a_gimbal_angles_are_left_to_the_mission(tmp_path: Path) -> None:
    path = tmp_path / "flight.klv"
    klv.write(path, flight(), gimbal=False)
    track = read(path)
    assert np.isnan(track.yaw_rad).all()
    assert track.aircraft_yaw_rad is not None
    assert np.isfinite(track.aircraft_yaw_rad).all()


def test_packets_twice_and_packets_from_nowhere_are_left_out(tmp_path: Path) -> None:
    path, whole = tmp_path / "flight.klv", klv.packets(flight())
    nowhere = klv.packet(START_NS // 1000 + 2_050_000, _values(flight(), 20) | {13: 0.0, 14: 0.0})
    path.write_bytes(b"".join([*whole[:21], whole[20], nowhere, *whole[21:]]))
    track = read(path)
    assert track.left_out == {"repeated": 1, "no_fix": 1}
    assert len(track.times_s) == len(whole)


@pytest.mark.parametrize(
    ("data", "found"),
    [
        (b"", "empty"),
        (b"no packets in here" * 20, "no packet"),
        (bytes.fromhex("060e2b34020101010e01010201010000") + b"\x02ab", "EG 0104"),
    ],
)
def test_a_file_without_positions_is_refused_in_one_line(tmp_path: Path, data: bytes, found: str) -> None:
    path = tmp_path / "flight.klv"
    path.write_bytes(data)
    with pytest.raises(InputError, match=found) as error:
        read(path)
    assert "\n" not in str(error.value)


def test_in_a_transport_stream_presentation_times_tie_it_to_the_video(tmp_path: Path) -> None:
    path, true = tmp_path / "flight.ts", flight(30)
    # the packets' own clock runs 7 s late: the presentation times count
    times_s = true.times_s + 0.05
    klv.write_stream(path, klv.packets(true), times_s.tolist())
    track = read(path)
    assert format_of(Telemetry(file=path)).name == "misb-klv"
    assert track.tied_to_video
    assert np.allclose(track.times_s, times_s, atol=2e-3)
    assert_same_flight(track, true)


@pytest.mark.parametrize("synchronous", [True, False])
def test_synchronous_and_asynchronous_metadata_are_tied_alike(tmp_path: Path, synchronous: bool) -> None:
    path, true = tmp_path / "flight.ts", flight(30)
    klv.write_metadata_stream(path, klv.packets(true), 0.02, synchronous=synchronous)
    track = read(path)
    assert np.allclose(track.times_s, true.times_s + 0.02, atol=1e-3)
    assert not track.assumed
    assert_same_flight(track, true)


def test_metadata_without_presentation_times_is_tied_by_its_place_and_that_is_said(tmp_path: Path) -> None:
    path, true = tmp_path / "flight.ts", flight(30)
    klv.write_metadata_stream(path, klv.packets(true), 0.0, synchronous=False, presentation_times=False)
    track = read(path)
    assert np.allclose(track.times_s, true.times_s, atol=1e-3)
    assert any("no presentation times" in sentence for sentence in track.assumed)


def test_several_packets_in_one_piece_keep_their_own_times(tmp_path: Path) -> None:
    path, true = tmp_path / "flight.ts", flight(30)
    whole = klv.packets(true)
    pieces = [b"".join(whole[i : i + 5]) for i in range(0, 30, 5)]
    klv.write_stream(path, pieces, [0.5 * i for i in range(6)])
    track = read(path)
    assert np.allclose(track.times_s, true.times_s, atol=2e-3)


def test_a_stream_without_metadata_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "flight.ts"
    klv.write_stream(path, [b"something else"], [0.1])
    with pytest.raises(InputError, match="without MISB"):
        read(path)


@pytest.mark.skipif(not DAY_FLIGHT.exists(), reason="no ../shared beside the repository")
def test_the_day_flight_looks_at_its_frame_centres() -> None:
    track = read(DAY_FLIGHT)
    assert len(track.times_s) == 6
    assert not track.left_out
    bearings = [46.113, 26.794, 25.093, 22.941, 20.424, 22.616]  # to the frame centres, by hand
    assert np.allclose(np.degrees(track.yaw_rad), bearings, atol=0.05)
    assert "count from north" in track.assumed[0]
    assert track.height_datum == "geoid"
    assert np.isclose(track.latitude_deg[0], 54.681323284, atol=1e-8)
    assert track.start_time_ns == 1_245_257_585_099_653_000
