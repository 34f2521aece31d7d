"""Flight logs in the CSV of each tool: what was laid in comes out, and one bad row costs that row."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.config.telemetry import Column, Telemetry
from pipeline.errors import InputError
from pipeline.ingest.clock import align
from pipeline.ingest.registry import format_of, read_telemetry
from pipeline.ingest.track import Track
from tests.dialects import airdata_csv, column_table, dji_flight_record_csv, litchi_csv

AIRDATA_DEMO = Path(__file__).parents[4] / "shared/data/cases/telemetry/airdata_demo.csv"
START_NS = 1_781_429_400_000_000_000  # 2026-06-14 09:30:00 UTC
FEET, TENTH_M = 0.1 * 0.3048, 0.1
DIALECTS: dict[str, tuple[str, Callable[..., None], float]] = {
    "airdata in feet": ("airdata-csv", airdata_csv.write, FEET),
    "airdata in metres": ("airdata-csv", partial(airdata_csv.write, unit="meters"), TENTH_M),
    "litchi": ("litchi-csv", litchi_csv.write, TENTH_M),
    "litchi in feet": ("litchi-csv", partial(litchi_csv.write, unit="feet"), FEET),
    "flight reader": ("dji-flight-record-csv", dji_flight_record_csv.write, FEET),
    "txtlogtocsv": (
        "dji-flight-record-csv",
        partial(dji_flight_record_csv.write, tool="txtlogtocsv"),
        TENTH_M,
    ),
    "dji-log-parser": (
        "dji-flight-record-csv",
        partial(dji_flight_record_csv.write, tool="dji-log-parser"),
        TENTH_M,
    ),
}


def true_track(rows: int = 60) -> Track:
    """Six seconds of a flight that climbs and turns, 10 Hz."""
    times_s = np.arange(rows) * 0.1
    return Track(
        START_NS,
        times_s,
        58.4 + 1e-5 * times_s,
        15.57 - 2e-5 * times_s,
        120.0 + 0.5 * times_s,
        20.0 + 0.5 * times_s,
        np.radians(170.0 + 5.0 * times_s),
        np.radians(-45.0 - times_s),
        np.radians(0.5 * np.ones(rows)),
    )


def read(path: Path, **kept: Any) -> Track:
    return read_telemetry(Telemetry(file=path, **kept))


@pytest.mark.parametrize("dialect", DIALECTS)
def test_what_was_laid_in_comes_out_to_the_resolution_of_the_dialect(tmp_path: Path, dialect: str) -> None:
    name, write, height_step_m = DIALECTS[dialect]
    path, true = tmp_path / "log.csv", true_track()
    write(path, true)
    assert format_of(Telemetry(file=path)).name == name
    track = read(path)
    assert not track.tied_to_video
    assert not track.left_out
    assert np.allclose(track.times_s - track.times_s[0], true.times_s, atol=1e-6)
    assert np.allclose(track.latitude_deg, true.latitude_deg, atol=6e-8)
    assert np.allclose(track.longitude_deg, true.longitude_deg, atol=6e-8)
    assert np.allclose(track.relative_height_m, true.relative_height_m, atol=0.51 * height_step_m)
    if not dialect.startswith("litchi"):
        assert np.allclose(track.absolute_height_m, true.absolute_height_m, atol=0.51 * height_step_m)
    for angle in ("yaw_rad", "pitch_rad", "roll_rad"):
        turn = np.exp(1j * getattr(track, angle)) / np.exp(1j * getattr(true, angle))
        assert np.allclose(np.angle(turn), 0.0, atol=math.radians(0.051))
    assert track.recording is not None
    assert track.recording.all()
    assert track.start_time_ns == pytest.approx(START_NS, abs=1_000_000)


def test_whole_seconds_and_milliseconds_make_one_smooth_clock(tmp_path: Path) -> None:
    """The first row lies 370 ms after a full second: the dates alone would be off by up to a second."""
    path, true = tmp_path / "log.csv", true_track()
    object.__setattr__(true, "start_time_ns", START_NS + 370_000_000)
    airdata_csv.write(path, true, first_ms=5_000)
    track = read(path)
    assert track.clock == "utc"
    assert abs(track.start_time_ns - true.start_time_ns) <= 100_000_000
    assert np.allclose(np.diff(track.times_s), 0.1)
    assert any("the clock is known to 0.1 s" in sentence for sentence in track.assumed)


def test_local_times_of_an_unknown_zone_are_called_local(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    dji_flight_record_csv.write(path, true_track(), zone="local")
    track = read(path)
    assert track.clock == "local"
    assert any("local" in sentence for sentence in track.assumed)
    stated = {
        "time": Column(name="CUSTOM.updateTime [local]", zone="+02:00"),
    }
    track = read(path, columns=stated)
    assert track.clock == "utc"
    assert track.start_time_ns == START_NS - 7_200_000_000_000


def test_raw_angles_that_equal_the_degrees_beside_them_are_degrees(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(
        "latitude,longitude,altitude(m),pitch(deg),yaw(deg),pitchRaw,yawRaw,gimbalPitchRaw,gimbalRollRaw,gimbalYawRaw,"
        "datetime(utc),isTakingVideo\n"
        "58.4,15.57,20.5,-5.0,180.0,-5.0,180.0,-15.0,0.0,180.0,2026-06-14 09:30:00.123,0\n"
        "58.4,15.57,20.5,-5.0,181.0,-5.0,181.0,-15.2,0.0,181.0,2026-06-14 09:30:00.223,1\n"
    )
    track = read(path)
    assert np.allclose(np.degrees(track.pitch_rad), [-15.0, -15.2])
    assert track.recording is not None
    assert track.recording.tolist() == [0.0, 1.0]


def test_degrees_that_no_degrees_can_be_are_tenths_and_that_is_said(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    airdata_csv.write(path, true_track())
    head, *rows = path.read_text().splitlines()
    names = head.split(",")
    changed = []
    for row in rows:
        cells = row.split(",")
        for name in ("gimbal_heading(degrees)", "gimbal_pitch(degrees)", "gimbal_roll(degrees)"):
            cells[names.index(name)] = str(round(float(cells[names.index(name)]) * 10))
        changed.append(",".join(cells))
    path.write_text("\n".join([head, *changed]))
    track = read(path)
    assert np.allclose(np.degrees(track.pitch_rad[0]), -45.0)
    assert any("tenths" in sentence for sentence in track.assumed)


CUT = "the rest of the row is missing"
BAD_ROWS = {
    "no position": ("58.400020000,15.569960000", ",", "no_fix"),
    "zeros for a position": ("58.400020000,15.569960000", "0.0,0.0", "no_fix"),
    "two satellites": (",17,5,15.2", ",2,0,15.2", "no_fix"),
    "no latitude": ("58.400020000", "5x", "no_fix"),
    "beyond the pole": ("58.400020000", "258.4", "impossible"),
    "no angle": (",-47.0,", ",,", "incomplete"),
    "cut": (",15.569960000", CUT, "incomplete"),
    "no time": ("2100,", "xx,", "no_time"),
    "an earlier time": ("2100,", "1750,", "out_of_order"),
    "a time far ahead": ("2100,", "99999999,", "out_of_order"),
    "the same time": ("2100,", "2000,", "repeated"),
    "more cells": (",88,", ",88,1,2,3,", "surplus_cells"),
}


@pytest.mark.parametrize("fault", BAD_ROWS)
def test_a_bad_row_costs_that_row_and_is_counted(tmp_path: Path, fault: str) -> None:
    path, true = tmp_path / "log.csv", true_track()
    airdata_csv.write(path, true, unit="meters")
    lines = path.read_text().splitlines()
    found, put, reason = BAD_ROWS[fault]
    assert found in lines[21]
    before, after = lines[21].split(found, 1)
    lines[21] = before if put == CUT else before + put + after
    path.write_text("\n".join(lines))
    track = read(path)
    assert len(track.times_s) == len(true.times_s) - 1
    assert reason in track.left_out
    assert not np.isclose(track.times_s - track.times_s[0], 2.0).any() or reason == "repeated"


def test_a_weak_fix_widens_the_position_and_a_good_one_leaves_it_to_the_mission(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    airdata_csv.write(path, true_track())
    assert read(path).horizontal_sd_m is None
    lines = path.read_text().splitlines()
    lines[21] = lines[21].replace(",17,5,15.2", ",7,3,15.2")
    path.write_text("\n".join(lines))
    track = read(path)
    assert track.horizontal_sd_m is not None
    assert np.flatnonzero(np.isfinite(track.horizontal_sd_m)).tolist() == [20]
    assert track.horizontal_sd_m[20] == 4.0


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "latin-1"])
def test_a_table_that_nobody_foresaw_is_read_by_its_map_of_columns(tmp_path: Path, encoding: str) -> None:
    path, true = tmp_path / "flug.csv", true_track()
    column_table.write(path, true, encoding)
    columns = {name: Column(**spelt) for name, spelt in column_table.COLUMNS.items()}
    track = read(path, columns=columns)
    assert format_of(Telemetry(file=path)).name == "table"
    assert track.clock == "utc"
    assert track.start_time_ns == START_NS
    assert np.allclose(track.times_s, true.times_s)
    assert np.allclose(track.latitude_deg, true.latitude_deg)
    assert np.allclose(track.absolute_height_m, true.absolute_height_m, atol=1e-3)
    assert np.allclose(track.yaw_rad, true.yaw_rad, atol=1e-6)


def test_an_unknown_table_is_answered_with_a_map_to_fill_in(tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    path.write_text("when;lat;lon;alt_ft;azimuth\n1,5;58,4;15,5;300;90\n1,6;58,4;15,5;301;91\n")
    with pytest.raises(InputError) as caught:
        read(path)
    text = str(caught.value)
    assert "\n" not in text
    assert (
        "columns: {time: {name: '?', unit: seconds, zone: utc}, latitude: {name: 'lat', unit: degrees}"
        in text
    )
    assert "absolute_height: {name: 'alt_ft', unit: ft}, yaw: {name: 'azimuth', unit: degrees}" in text


def test_a_column_that_is_not_there_is_named_with_those_that_are(tmp_path: Path) -> None:
    path = tmp_path / "own.csv"
    path.write_text("t,lat,lon\n1,58.4,15.5\n2,58.4,15.5\n")
    columns = {
        "time": Column(name="t", unit="seconds"),
        "latitude": Column(name="Lat"),
        "longitude": Column(name="lng"),
    }
    with pytest.raises(
        InputError,
        match=r"telemetry.columns.longitude.name: found no column 'lng'; expected one of t, lat, lon",
    ):
        read(path, columns=columns)


def test_a_selection_of_airdatas_columns_is_airdatas(tmp_path: Path) -> None:
    """The first dates may be empty; rows before the fix stand at 0, 0; a message may have commas."""
    path = tmp_path / "log.csv"
    path.write_text(
        "time(millisecond),datetime(utc),latitude,longitude,height_sonar(feet),satellites,gimbal_heading(degrees),"
        "gimbal_pitch(degrees),ascent(feet),flycState,message\n"
        "0,,0,0,0.3,0,270.2,-45,0,P-GPS,Max altitude set to 98 ft (Code: 30015)\n"
        "100,2026-06-14 09:29:59,0,0,0.3,7,270.2,-45,0,P-GPS,\n"
        "200,2026-06-14 09:30:00,58.4,15.5,0.3,9,270.2,-45,0,P-GPS,Home Point recorded. Height 61m, speed 3 m/s, wind\n"
        "300,2026-06-14 09:30:00,58.4,15.5,0.3,9,270.2,-45,0,P-GPS,\n"
    )
    assert format_of(Telemetry(file=path)).name == "airdata-csv"
    track = read(path)
    assert (track.start_time_ns, dict(track.left_out)) == (START_NS, {"no_fix": 2})
    assert track.first_left_out["no_fix"] == f"{path}:2"
    assert track.horizontal_sd_m is not None
    assert track.horizontal_sd_m.tolist() == [2.0, 2.0]


def test_the_finer_of_two_times_of_flight_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = "".join(
        f"{1781429400 + k // 4},0m {k / 4:.2f}s,{k // 4},58.4,15.5,65.6,{k > 4}\n" for k in range(12)
    )
    head = (
        "timestamps,OSD.flyTime,OSD.flyTime [s],OSD.latitude,OSD.longitude,OSD.height [ft],CAMERA.isVideo\n"
    )
    path.write_text(head + rows)
    track = read(path)
    assert (track.start_time_ns, track.clock) == (START_NS, "utc")
    assert np.allclose(np.diff(track.times_s), 0.25)
    assert track.recording is not None
    assert track.recording.sum() == 7


def test_a_log_of_several_recordings_gives_that_of_the_video(tmp_path: Path) -> None:
    """Ten, six and three seconds of recording, two seconds apart; the video lasts six."""
    path, true = tmp_path / "log.csv", true_track(300)
    dji_flight_record_csv.write(path, true)
    head, names, *lines = path.read_text(encoding="utf-8-sig").splitlines()
    on = [20 <= k < 120 or 140 <= k <= 200 or 220 <= k < 250 for k in range(300)]
    path.write_text(
        "\n".join(
            [
                head,
                names,
                *(line.replace("False,True", f"False,{o}") for line, o in zip(lines, on, strict=True)),
            ]
        )
    )
    track = read(path)
    alignment = align(track, Telemetry(file=path), 6.0, None, path)
    assert alignment.offset_s == pytest.approx(-(track.times_s[140]))
    with pytest.raises(InputError, match="time_offset"):
        align(track, Telemetry(file=path), 4.5, None, path)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("DJIFlightRecord_2026-06-14_[09-30-00].txt", "encrypted; expected it decoded to CSV"),
        ("flight.xlsx", "a spreadsheet; expected it saved as CSV"),
    ],
)
def test_a_file_that_must_be_decoded_first_says_so(tmp_path: Path, name: str, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"PK\3\4" + bytes(range(256)) * 9)
    with pytest.raises(InputError, match=message):
        read(path)
    text = tmp_path / "DJIFlightRecord_2026-06-14.txt"
    dji_flight_record_csv.write(text, true_track())
    assert format_of(Telemetry(file=text)).name == "dji-flight-record-csv"


@pytest.mark.skipif(not AIRDATA_DEMO.exists(), reason="needs ../shared")
def test_the_demo_as_airdata_writes_it() -> None:
    track = read(AIRDATA_DEMO)
    assert (len(track.times_s), track.start_time_ns, track.clock) == (468, START_NS, "utc")
    assert track.height_datum == "geoid"
    assert track.absolute_height_m[0] == pytest.approx(128.651, abs=0.0153)
    assert track.relative_height_m[0] == pytest.approx(15.384, abs=0.0153)
    assert np.degrees(track.pitch_rad[0]) == pytest.approx(-45.0)
