"""Logs of autopilots: what was laid in comes out; each fault costs what it hits, and is named."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as m

from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.geo.pose import enu_from_camera
from pipeline.ingest.clock import recordings_s
from pipeline.ingest.registry import format_of, read_telemetry
from pipeline.ingest.track import Track
from tests.dialects import ardupilot_bin, mavlink_tlog, ulog
from tests.dialects.attitudes import aircraft_of
from tests.dialects.tracks import START_NS, flight

PX4_SMALL = Path(__file__).parents[4] / "shared/data/telemetry/px4_small.ulg"
DIALECTS: dict[str, tuple[str, Callable[..., None]]] = {
    "tlog, gimbal device from the vehicle": ("mavlink-tlog", mavlink_tlog.write),
    "tlog, gimbal device from north": ("mavlink-tlog", partial(mavlink_tlog.write, gimbal="device-north")),
    "tlog, mount orientation": ("mavlink-tlog", partial(mavlink_tlog.write, gimbal="orientation")),
    "dataflash, POS": ("ardupilot-bin", ardupilot_bin.write),
    "dataflash, GPS": ("ardupilot-bin", partial(ardupilot_bin.write, source="GPS")),
    "dataflash, AHR2": ("ardupilot-bin", partial(ardupilot_bin.write, source="AHR2")),
    "ulog, whole numbers": ("px4-ulog", ulog.write),
    "ulog, degrees": ("px4-ulog", partial(ulog.write, source="new")),
    "ulog, estimate": ("px4-ulog", partial(ulog.write, source="estimate")),
    "ulog, mount": ("px4-ulog", partial(ulog.write, gimbal="mount")),
}
#: what each says of heights above take-off and of the date
NO_DATE = {"dataflash, AHR2", "ulog, estimate"}


def read(path: Path, **kept: Any) -> Track:
    return read_telemetry(Telemetry(file=path, **kept))


def assert_same_flight(track: Track, true: Track, angle: float = 1e-3) -> None:
    assert np.allclose(track.latitude_deg, true.latitude_deg, atol=6e-8)
    assert np.allclose(track.longitude_deg, true.longitude_deg, atol=6e-8)
    assert np.allclose(track.absolute_height_m, true.absolute_height_m, atol=6e-3)
    for i in range(len(true.times_s)):
        one, other = (enu_from_camera(t.yaw_rad[i], t.pitch_rad[i], t.roll_rad[i]) for t in (track, true))
        assert np.allclose(one, other, atol=angle), i


@pytest.mark.parametrize("dialect", DIALECTS)
def test_what_was_laid_in_comes_out(tmp_path: Path, dialect: str) -> None:
    name, write = DIALECTS[dialect]
    path, true = tmp_path / "log.bin", flight()
    write(path, true)
    assert format_of(Telemetry(file=path)).name == name
    track = read(path)
    assert not track.left_out
    assert not track.tied_to_video
    assert track.height_datum == "geoid"
    times_s = track.times_s - track.times_s[0]
    assert np.allclose(times_s, true.times_s, atol=2e-3)
    assert_same_flight(track, true)
    assert track.aircraft_yaw_rad is not None
    expected = [aircraft_of(yaw)[0] for yaw in true.yaw_rad]
    assert np.allclose(np.cos(track.aircraft_yaw_rad - np.array(expected)), 1.0, atol=1e-5)
    if dialect in NO_DATE:
        assert track.clock == "unknown"
    else:
        assert track.clock == "utc"
        assert abs(track.start_time_ns - START_NS) < 2_000_000
        assert track.horizontal_sd_m is not None
        assert np.allclose(track.horizontal_sd_m, 0.9 / math.sqrt(2.0))


def test_mount_status_counts_from_the_nose_at_the_time_it_was_received(tmp_path: Path) -> None:
    path, true = tmp_path / "log.tlog", flight()
    mavlink_tlog.write(path, true, gimbal="status")
    track = read(path)
    # it has no time of its own: the attitude that it is read with lies up to 80 ms away
    for name in ("yaw_rad", "pitch_rad"):
        expected = np.interp(track.times_s, true.times_s, np.unwrap(getattr(true, name)))
        turned = np.mod(getattr(track, name) - expected + math.pi, 2 * math.pi) - math.pi
        assert np.nanmax(np.abs(turned)) < math.radians(0.6)
    assert any("MOUNT_STATUS" in sentence for sentence in track.assumed)


def test_a_gimbal_that_is_faster_than_the_positions_keeps_its_angles(tmp_path: Path) -> None:
    path, true = tmp_path / "log.tlog", flight(60)
    log = mavlink_tlog.Log(START_NS // 1000)
    log.add(0.0, mavlink_tlog.heartbeat())
    for i, time_s in enumerate(true.times_s.tolist()):
        boot_ms = mavlink_tlog.BOOT_MS + round(time_s * 1000)
        yaw, pitch, roll = aircraft_of(float(true.yaw_rad[i]))
        log.add(time_s, m.MAVLink_attitude_message(boot_ms, roll, pitch, yaw, 0, 0, 0))
        log.add(time_s, mavlink_tlog.gimbal_message("device", true, i, boot_ms), component=154)
        if i % 10 == 0:
            log.add(time_s, mavlink_tlog.position(true, i, boot_ms))
    path.write_bytes(bytes(log.data))
    track = read(path)
    assert len(track.times_s) == 51  # between the first and the last position
    assert_same_flight(track, _part(true, 51))


def _part(track: Track, rows: int) -> Track:
    arrays = (
        "times_s",
        "latitude_deg",
        "longitude_deg",
        "absolute_height_m",
        "yaw_rad",
        "pitch_rad",
        "roll_rad",
    )
    return Track(
        track.start_time_ns, *(getattr(track, n)[:rows] for n in arrays[:4]), track.relative_height_m[:rows],
        *(getattr(track, n)[:rows] for n in arrays[4:]),
    )  # fmt: skip


def test_of_two_vehicles_the_mission_names_one(tmp_path: Path) -> None:
    path, one, other = tmp_path / "log.tlog", flight(), flight()
    log = mavlink_tlog.log_of(one)
    for i, time_s in enumerate(other.times_s.tolist()):
        log.add(time_s, mavlink_tlog.heartbeat(), 2)
        log.add(time_s, mavlink_tlog.position(other, i, 1000 + round(time_s * 1000)), 2)
    path.write_bytes(bytes(log.data))
    with pytest.raises(InputError, match=r"several vehicles, systems 1 .*, 2 .*telemetry\.system_id"):
        read(path)
    assert np.isfinite(read(path, system_id=1).yaw_rad).all()
    assert np.isnan(read(path, system_id=2).yaw_rad).all()
    with pytest.raises(InputError, match="no position of system 7"):
        read(path, system_id=7)


def test_a_ground_station_that_sends_its_own_position_is_no_vehicle(tmp_path: Path) -> None:
    path, true = tmp_path / "log.tlog", flight()
    log = mavlink_tlog.log_of(true)
    log.add(6.0, mavlink_tlog.position(true, 0, 9000), 255, 190)
    path.write_bytes(bytes(log.data))
    assert_same_flight(read(path), true)


def test_positions_without_a_fix_are_left_out(tmp_path: Path) -> None:
    true = flight()
    log = mavlink_tlog.log_of(true)
    path = tmp_path / "log.tlog"
    parts = []
    for i, time_s in enumerate(true.times_s.tolist()):
        boot_ms = mavlink_tlog.BOOT_MS + round(time_s * 1000)
        single = mavlink_tlog.Log(START_NS // 1000)
        single.add(time_s, mavlink_tlog.fix(boot_ms, 1 if 20 <= i < 30 else 3))
        single.add(time_s, mavlink_tlog.position(true, i, boot_ms))
        parts.append(bytes(single.data))
    path.write_bytes(bytes(mavlink_tlog.Log(0).data) + b"".join(parts))
    track = read(path)
    assert track.left_out == {"no_fix": 10}
    assert len(track.times_s) == 50
    assert log.data


def test_damage_in_a_tlog_costs_what_it_hits(tmp_path: Path) -> None:
    path, true = tmp_path / "log.tlog", flight()
    data = bytearray(mavlink_tlog.log_of(true).data)
    middle = len(data) // 2
    data[middle : middle + 40] = b"\xfd" * 40
    path.write_bytes(bytes(data))
    track = read(path)
    assert 57 <= len(track.times_s) < 60 or track.left_out
    assert sum(track.left_out.values()) >= 1
    assert np.interp(track.times_s[-1], true.times_s, true.latitude_deg) == pytest.approx(
        track.latitude_deg[-1], abs=1e-6
    )


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("share", [0.35, 0.7])
def test_a_log_cut_off_gives_what_is_whole(tmp_path: Path, dialect: str, share: float) -> None:
    path, true = tmp_path / "log.bin", flight()
    DIALECTS[dialect][1](path, true)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    track = read(path)
    rows = len(track.times_s)
    assert abs(rows / len(true.times_s) - share) < 0.2
    assert np.allclose(track.latitude_deg, true.latitude_deg[:rows], atol=6e-8)


def test_a_restart_in_the_log_is_said_and_its_flights_stay_apart(tmp_path: Path) -> None:
    path, true = tmp_path / "log.tlog", flight()
    log = mavlink_tlog.log_of(true)
    for i, time_s in enumerate(true.times_s.tolist()):
        log.add(100.0 + time_s, mavlink_tlog.position(true, i, 3000 + round(time_s * 1000)))
    path.write_bytes(bytes(log.data))
    track = read(path)
    assert any("started again" in sentence for sentence in track.assumed)
    assert track.times_s[-1] - track.times_s[0] == pytest.approx(105.9, abs=0.1)


def test_one_leap_of_time_is_left_out(tmp_path: Path) -> None:
    path, true = tmp_path / "log.bin", flight()
    ardupilot_bin.write(path, true, source="GPS", gimbal=False)
    leap = ardupilot_bin.gps(true, 20, 9_000_000_000)
    at = path.read_bytes().find(ardupilot_bin.gps(true, 21, ardupilot_bin.BOOT_US + 2_100_000))
    path.write_bytes(path.read_bytes()[:at] + leap + path.read_bytes()[at:])
    track = read(path)
    assert track.left_out == {"out_of_order": 1}
    assert len(track.times_s) == 60


def test_recording_in_the_log_is_known(tmp_path: Path) -> None:
    path = tmp_path / "log.tlog"
    mavlink_tlog.write(path, flight(), recording=(1.0, 4.0))
    ((start_s, length_s),) = recordings_s(read(path))
    assert start_s == pytest.approx(1.0, abs=0.11)
    assert length_s == pytest.approx(3.0, abs=0.21)


def test_the_oldest_dataflash_logs_count_since_boot_in_a_field_of_their_own(tmp_path: Path) -> None:
    path, true = tmp_path / "log.bin", flight()
    data = ardupilot_bin.describe(137, "GPS", *ardupilot_bin.KINDS["OLD"][1:]) + ardupilot_bin.head("ATT")
    for i, time_s in enumerate(true.times_s.tolist()):
        lat, lng = round(true.latitude_deg[i] * 1e7), round(true.longitude_deg[i] * 1e7)
        heights = (round(v[i] * 100) for v in (true.relative_height_m, true.absolute_height_m))
        own_ms = 30_000 + round(time_s * 1000)
        data += ardupilot_bin.message(
            "OLD", 3, 32_000_000 + round(time_s * 1000), 1775, 9, 120, lat, lng, *heights, 0, own_ms
        )
        data += ardupilot_bin.message("ATT", own_ms * 1000, 0, 1.0, 0, 2.0, 0, 33.0)
    path.write_bytes(data)
    track = read(path)
    assert np.allclose(track.times_s, 30.0 + true.times_s)
    assert np.allclose(track.relative_height_m, true.relative_height_m, atol=0.01)
    assert track.aircraft_yaw_rad is not None
    assert np.allclose(np.degrees(track.aircraft_yaw_rad[:-1]), 33.0)
    assert track.clock == "utc"


def test_noise_of_megabytes_between_messages_is_stepped_over_soon(tmp_path: Path) -> None:
    path, true = tmp_path / "log.tlog", flight()
    data = bytes(mavlink_tlog.log_of(true).data)
    path.write_bytes(data + b"\xfd\x00" * 1_000_000 + bytes(1_000_000) + data[: len(data) // 2])
    started = time.process_time()
    track = read(path)
    assert time.process_time() - started < 5.0
    assert len(track.times_s) >= 60
    assert sum(track.left_out.values()) >= 1


def test_of_two_receivers_the_first_is_taken_and_said(tmp_path: Path) -> None:
    path, true = tmp_path / "log.bin", flight()
    ardupilot_bin.write(path, true, source="GPS", gimbal=False)
    with path.open("ab") as file:
        for i in range(60):
            file.write(ardupilot_bin.gps(true, 0, 40_000_000 + i, instance=1))
    track = read(path)
    assert len(track.times_s) == 60
    assert any("instances of GPS" in sentence for sentence in track.assumed)


@pytest.mark.parametrize("kind", ["mavlink", "dataflash", "ulog"])
def test_other_messages_only_are_refused_in_one_line(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "log.bin"
    if kind == "mavlink":
        log = mavlink_tlog.Log(START_NS // 1000)
        for i in range(20):
            log.add(0.1 * i, mavlink_tlog.heartbeat())
        path.write_bytes(bytes(log.data))
    elif kind == "dataflash":
        path.write_bytes(ardupilot_bin.head("BAT") + ardupilot_bin.message("BAT", 1, 2.0) * 20)
    else:
        own = ulog.Log([ulog.OTHER])
        for i in range(20):
            own.add("cpuload", i, 0.5)
        path.write_bytes(bytes(own.data))
    with pytest.raises(InputError) as error:
        read(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["log.tlog", "log.bin", "log.ulg"])
def test_an_empty_log_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"")
    formats = {"log.tlog": "mavlink-tlog", "log.bin": "ardupilot-bin", "log.ulg": "px4-ulog"}
    with pytest.raises(InputError, match="an empty file"):
        read(path, format=formats[name])


@pytest.mark.skipif(not PX4_SMALL.exists(), reason="no ../shared beside the repository")
def test_the_log_of_px4_is_read_to_its_values() -> None:
    track = read(PX4_SMALL)
    assert len(track.times_s) == 32
    assert track.latitude_deg[[0, -1]].tolist() == pytest.approx([63.4170622, 63.4170457], abs=1e-9)
    assert track.longitude_deg[[0, -1]].tolist() == pytest.approx([10.4082151, 10.4082271], abs=1e-9)
    assert track.absolute_height_m[[0, -1]].tolist() == pytest.approx([66.814, 62.977], abs=1e-9)
    assert track.height_datum == "geoid"
    assert track.aircraft_yaw_rad is not None
    assert np.isfinite(track.aircraft_yaw_rad).all()
    assert np.isnan(track.yaw_rad).all()
    assert track.clock == "utc"
