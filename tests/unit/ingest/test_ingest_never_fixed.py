"""Telemetry of a receiver that never had a fix: it is read, it places no picture, and what it does know can be used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.config.telemetry import Column, Telemetry
from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.ground import middle_of
from pipeline.ingest.joined import joined
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory import Trajectory
from pipeline.ingest.trajectory_of import Ground, trajectory_of
from pipeline.init.contents import contents_of
from tests.dialects import dji_subtitles, gpmf, klv, mavlink_tlog
from tests.dialects.tracks import START_NS, flight
from tests.stills import write_still

WHEN = datetime(2026, 6, 14, 9, 30, tzinfo=UTC)
GROUND = Ground("ellipsoid", lambda east, north: 100.0)
ROWS = 60


def subtitles(path: Path) -> None:
    """A drone indoors: its gimbal turns, its receiver writes zeros."""
    nowhere = replace(flight(ROWS), latitude_deg=np.zeros(ROWS), longitude_deg=np.zeros(ROWS))
    dji_subtitles.write(path, nowhere, dji_subtitles.brackets)


def table(path: Path) -> None:
    rows = "".join(f"{0.1 * k:.1f},0,0,{10 + k},-45\n" for k in range(ROWS))
    path.write_text("t,lat,lon,yaw,pitch\n" + rows)


def packets(path: Path) -> None:
    path.write_bytes(
        b"".join(klv.packet(START_NS // 1000 + 100_000 * k, {13: 0.0, 14: 0.0}) for k in range(ROWS))
    )


def tlog(path: Path) -> None:
    """The autopilot goes on with what it last knew; the receiver says that it has no fix."""
    true, log = flight(ROWS), mavlink_tlog.Log(START_NS // 1000)
    for i, time_s in enumerate(true.times_s.tolist()):
        boot_ms = mavlink_tlog.BOOT_MS + round(time_s * 1000)
        log.add(time_s, mavlink_tlog.fix(boot_ms, 1))
        log.add(time_s, mavlink_tlog.position(true, i, boot_ms))
        log.add(time_s, mavlink_tlog.gimbal_message("device-north", true, i, boot_ms))
    path.write_bytes(bytes(log.data))


def gopro(path: Path) -> None:
    gps = gpmf.gps5([(33.1, -117.3, 12.0)] * ROWS, WHEN, fix=0)
    path.write_bytes(gpmf.payload(gps))


COLUMNS = {
    "time": Column(name="t", unit="s", zone="video"),
    "latitude": Column(name="lat"),
    "longitude": Column(name="lon"),
    "yaw": Column(name="yaw"),
    "pitch": Column(name="pitch"),
}
WRITERS: dict[str, tuple[Callable[[Path], None], str, dict[str, Column]]] = {
    "subtitles": (subtitles, "f.srt", {}),
    "table": (table, "f.csv", COLUMNS),
    "klv": (packets, "f.klv", {}),
    "tlog": (tlog, "f.tlog", {}),
    "gopro": (gopro, "f.raw", {}),
}


def telemetry(folder: Path, name: str) -> Telemetry:
    write, file, columns = WRITERS[name]
    write(folder / file)
    return Telemetry.model_validate(
        {
            "file": folder / file,
            "gimbal": {"pitch": {"degrees": -45}, "yaw": {"degrees": 0}},
            "height": "relative",
        }
    ).model_copy(update={"columns": columns})


def way(track: Track, told: Telemetry, angles: Track | None = None) -> Trajectory:
    return trajectory_of(track, told, LocalFrame(58.4, 15.57), GROUND, angles=angles)


@pytest.mark.parametrize("name", WRITERS)
def test_it_is_read_and_gives_no_pose(tmp_path: Path, name: str) -> None:
    told = telemetry(tmp_path, name)
    track = read_telemetry(told)
    assert dict(track.left_out) == {"no_fix": ROWS}
    assert not track.has_position.any()
    assert len(track.times_s) >= ROWS
    with pytest.raises(
        InputError, match=r"fix in none of them; expected positions from another file"
    ) as refused:
        way(track, told)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", ["subtitles", "table", "tlog"])
def test_its_angles_turn_the_camera_of_another_files_positions(tmp_path: Path, name: str) -> None:
    unplaced = read_telemetry(telemetry(tmp_path, name))
    assert np.isfinite(unplaced.yaw_rad).all()
    placed = replace(flight(ROWS), yaw_rad=np.full(ROWS, np.nan), pitch_rad=np.full(ROWS, np.nan))
    file = tmp_path / "gimbal"
    told = Telemetry.model_validate({"file": "f.srt", "height_datum": "ellipsoid", "angles": {"file": file}})
    angles = replace(unplaced, times_s=unplaced.times_s - unplaced.times_s[0])
    pose = way(placed, told, angles).pose(1.0)
    assert pose is not None
    own = {
        f"{name}_rad": np.nan_to_num(getattr(unplaced, f"{name}_rad"))[:ROWS]
        for name in ("yaw", "pitch", "roll")
    }
    expected = way(replace(placed, **own), told.model_copy(update={"angles": None})).pose(1.0)
    assert expected is not None
    assert np.allclose(pose.enu_from_camera, expected.enu_from_camera, atol=1e-3)


def test_a_recording_without_a_fix_costs_its_own_pictures(tmp_path: Path) -> None:
    """The frame of the map is not drawn to where the receiver last was, either."""
    subtitles(tmp_path / "first.srt")
    first, second = read_telemetry(Telemetry(file=tmp_path / "first.srt")), flight(ROWS)
    both = joined([first, second], [0.0, 10.0], "files")
    trajectory = way(both, Telemetry(file=tmp_path / "first.srt", height_datum="ellipsoid"))
    assert trajectory.pose(3.0) is None
    assert trajectory.pose(12.0) is not None
    assert abs(middle_of([both]).origin_latitude_deg - 58.4) < 0.01


def test_in_a_folder_it_is_left_aside_by_name(tmp_path: Path) -> None:
    for name in ("subtitles", "gopro", "tlog"):
        telemetry(tmp_path, name)
    contents = contents_of(tmp_path)
    assert contents.telemetry == {}
    assert set(contents.unused.values()) == {f"{ROWS} samples, none with a position"}


@pytest.mark.parametrize("gps", ["zeros", "none"])
def test_an_album_without_positions_is_left_aside_by_name(tmp_path: Path, gps: str) -> None:
    picture = np.zeros((64, 96, 3), np.uint8)
    for k in range(6):
        path = tmp_path / f"IMG_{k}.JPG"
        write_still(path, picture, WHEN + timedelta(seconds=k), 0.0, 0.0, 0.0, {})
        if gps == "none":
            with Image.open(path) as image:
                exif = image.getexif()
                exif.get_ifd(0x8825).clear()
                del exif[0x8825]
                image.save(path, exif=exif)
    contents = contents_of(tmp_path)
    assert contents.stills == ()
    assert contents.unused == {tmp_path: "6 stills, none with a position"}


def test_one_fix_is_enough_to_leave_the_others_out(tmp_path: Path) -> None:
    path = tmp_path / "f.raw"
    rows = [(33.1, -117.3, 12.0)] * 10
    path.write_bytes(
        gpmf.payload(gpmf.gps5(rows, WHEN, fix=0)) + gpmf.payload(gpmf.gps5(rows[:1], WHEN, fix=3))
    )
    track = read_telemetry(Telemetry(file=path))
    assert (len(track.times_s), dict(track.left_out)) == (1, {"no_fix": 10})
    assert track.has_position.all()
