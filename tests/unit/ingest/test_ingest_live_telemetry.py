"""Telemetry beside a live stream: MAVLink over UDP, files that grow, and the way that they make."""

from __future__ import annotations

import pickle
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.config.stream_url import StreamUrl
from pipeline.config.telemetry import Telemetry
from pipeline.config.uncertainty import Uncertainty
from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.live.arrivals import Arrivals
from pipeline.ingest.live.growing_file import GrowingFile
from pipeline.ingest.live.live_trajectory import WAY_COLUMNS, LiveTrajectory, WayRecipe, rows_of
from pipeline.ingest.live.mavlink_udp import MavlinkUdp
from pipeline.ingest.live.telemetry_thread import TelemetryThread
from pipeline.ingest.telemetry.mavlink_frames import frames_in
from pipeline.ingest.track import Track
from pipeline.ingest.trajectory import Trajectory
from pipeline.ingest.trajectory_of import Ground
from tests.dialects import airdata_csv, dji_subtitles, mavlink_tlog
from tests.dialects.tracks import START_NS, flight
from tests.unit.ingest.live_streams import free_port


def _send(port: int, frames: list[bytes]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for frame in frames:
            out.sendto(frame, ("127.0.0.1", port))


def _log(rows: Track) -> list[tuple[float, bytes]]:
    """Frames as they are received, with the seconds since the first."""
    data, found, position = bytes(mavlink_tlog.log_of(rows).data), [], 0
    while position < len(data):
        frame = next(frames_in(data[position + 8 :]))
        stamp_us = int.from_bytes(data[position : position + 8], "big")
        found.append((stamp_us * 1e-6, frame))
        position += 8 + len(frame)
    return [(at - found[0][0], frame) for at, frame in found]


class _Now:
    """A clock that a test sets, microseconds since 1970."""

    def __init__(self) -> None:
        self.us = START_NS // 1000

    def __call__(self) -> int:
        return self.us


@pytest.mark.parametrize("late_s", [0.0, 0.3])
def test_mavlink_over_udp_is_the_log_of_what_was_received(late_s: float) -> None:
    now, rows = _Now(), flight(40)
    port = free_port()
    url = StreamUrl(f"udp://127.0.0.1:{port}")
    heard = MavlinkUdp(url, Telemetry(file=Path("-"), heard=url), now)
    track = None
    for at_s, frame in _log(rows):
        now.us = START_NS // 1000 + round((at_s + late_s) * 1e6)
        _send(port, [b"\x00\xfe\x03", frame + b"garbage"] if at_s > 1.0 else [frame])
        track = heard.track(0.05) or track
    heard.close()
    assert track is not None
    assert track.clock == "utc"
    at_s = (track.start_time_ns - START_NS) * 1e-9 + track.times_s - track.times_s[0]
    assert float(at_s[-1]) == pytest.approx(float(rows.times_s[-1]) + late_s, abs=0.05)
    latitude = np.interp(at_s - late_s, rows.times_s, rows.latitude_deg)
    np.testing.assert_allclose(track.latitude_deg, latitude, atol=1e-6)
    np.testing.assert_allclose(
        track.pitch_rad[5:], np.interp(at_s - late_s, rows.times_s, rows.pitch_rad)[5:], atol=0.01
    )


def test_bytes_that_are_no_mavlink_are_no_track() -> None:
    port, now = free_port(), _Now()
    url = StreamUrl(f"udp://127.0.0.1:{port}")
    heard = MavlinkUdp(url, Telemetry(file=Path("-"), heard=url), now)
    _send(port, [b"", b"\xfd", b"\xfd\xff" * 40, bytes(range(256)), b"\xfe" * 1400])
    assert heard.track(0.05) is None
    heard.close()


def test_a_port_that_somebody_has_is_told() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        url = StreamUrl(f"udp://127.0.0.1:{taken.getsockname()[1]}")
        with pytest.raises(InputError, match="cannot be listened on"):
            MavlinkUdp(url, Telemetry(file=Path("-"), heard=url), _Now())


def _cut(rows: Track, count: int) -> Track:
    columns = {
        name: value[:count]
        for name, value in ((n, getattr(rows, n)) for n in rows.__slots__)
        if isinstance(value, np.ndarray)
    }
    return replace(rows, **columns)


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("a.csv", airdata_csv.write),
        ("a.tlog", mavlink_tlog.write),
        ("a.srt", lambda path, rows: dji_subtitles.write(path, rows, dji_subtitles.brackets)),
        (
            "b.srt",
            lambda path, rows: dji_subtitles.write(path, rows, dji_subtitles.brackets, "utf-8", "\r\n"),
        ),
    ],
)
def test_of_a_file_that_grows_the_newest_samples_are_read_as_of_a_whole_one(
    name: str, write: Callable[..., None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.ingest.live.growing_file._TAIL_BYTES", 9000)
    monkeypatch.setattr("pipeline.ingest.live.growing_file._HEAD_BYTES", 2000)
    rows, now_s = flight(200), START_NS * 1e-9
    whole = tmp_path / f"whole-{name}"
    write(whole, rows)
    data, path = whole.read_bytes(), tmp_path / name
    path.write_bytes(b"")
    clock = [now_s]
    grows = GrowingFile(Telemetry(file=path), lambda: clock[0])
    assert grows.track(0.0) is None
    seen = None
    for k in range(1, 21):
        path.write_bytes(data[: len(data) * k // 20])
        clock[0] = now_s + k
        seen = grows.track(0.0) or seen
    assert seen is not None
    assert grows.track(0.0) is None, "it has not grown"
    assert len(seen.times_s) < 190
    newest_s = (seen.start_time_ns - START_NS) * 1e-9 + float(seen.times_s[-1] - seen.times_s[0])
    assert newest_s == pytest.approx(20.0, abs=1.1)
    assert float(seen.latitude_deg[-1]) == pytest.approx(float(rows.latitude_deg[-1]), abs=1e-5)


def test_a_table_of_ones_own_keeps_its_head(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.ingest.live.growing_file._TAIL_BYTES", 2000)
    path = tmp_path / "a.csv"
    lines = [f"2026-06-14T09:30:{k * 0.1:06.3f}Z,58.4,15.57,{100 + k * 0.1:.1f},10,-45" for k in range(200)]
    path.write_text("When,Lat,Lon,Up,Yaw,Pitch\n" + "\n".join(lines) + "\n", encoding="utf-8")
    columns = {"time": {"name": "When"}, "latitude": {"name": "Lat"}, "longitude": {"name": "Lon"}}
    columns |= {"absolute_height": {"name": "Up"}, "yaw": {"name": "Yaw"}, "pitch": {"name": "Pitch"}}
    told = Telemetry.model_validate({"file": path, "columns": columns})
    track = GrowingFile(told, lambda: START_NS * 1e-9 + 20.0).track(0.0)
    assert track is not None
    assert 10 < len(track.times_s) < 60
    assert float(track.absolute_height_m[-1]) == pytest.approx(119.9)


# --- the way


def _way(rows: Track) -> tuple[LiveTrajectory, WayRecipe]:
    told = Telemetry.model_validate({"file": "-", "height_datum": "ellipsoid"})
    frame = LocalFrame(58.4, 15.57)
    recipe = WayRecipe(told, frame, Ground("ellipsoid", _flat), Uncertainty(), None)
    return LiveTrajectory(recipe.trajectory(rows), recipe), recipe


def _flat(east: float, north: float) -> float:
    return 0.0


def _window(rows: Track, first: int, last: int) -> Track:
    columns = {
        name: value[first:last]
        for name, value in ((n, getattr(rows, n)) for n in rows.__slots__)
        if isinstance(value, np.ndarray)
    }
    return replace(rows, **columns, start_time_ns=rows.start_time_ns + first * 100_000_000)


def test_a_way_that_grows_gives_the_poses_of_the_whole_one() -> None:
    rows = flight(300)
    way, recipe = _way(_window(rows, 0, 10))
    whole: Trajectory = recipe.trajectory(rows)
    kept = []
    for last in range(10, 300, 5):
        way.extend(_window(rows, max(0, last - 100), last))
        kept.append(way.take_rows())
        for time_s in (0.1 * (last - 20), 0.1 * last - 0.33):
            if time_s > 0.2:
                np.testing.assert_allclose(
                    way.pose(time_s).position_enu, whole.pose(time_s).position_enu, atol=1e-6
                )
    kept.append(way.take_rows(all_of_it=True))
    flown = way.flown(np.concatenate(kept))
    np.testing.assert_allclose(
        rows_of(flown), rows_of(whole)[: len(flown.times_s)], atol=1e-6, equal_nan=True
    )
    assert len(flown.times_s) == 295
    assert flown.start_ns == whole.start_ns
    assert way.pose(40.0) is None, "what is not known yet is nowhere"


def test_it_travels_without_what_it_has_learnt() -> None:
    rows = flight(60)
    way, _ = _way(_window(rows, 0, 10))
    way.extend(_window(rows, 0, 60))
    other = pickle.loads(pickle.dumps(way))
    assert (len(way.times_s), len(other.times_s)) == (60, 10)
    assert other.take_rows().shape == (0, WAY_COLUMNS)


def test_who_waits_for_a_sample_is_woken_by_it_and_waits_no_longer_than_told() -> None:
    rows = flight(60)
    way, _ = _way(_window(rows, 0, 10))
    began_s = time.monotonic()
    assert not way.wait_until_known(3.0, 0.1)
    threading.Timer(0.1, way.extend, [_window(rows, 0, 40)]).start()
    assert way.wait_until_known(3.0, 5.0)
    assert time.monotonic() - began_s < 2.0


def test_samples_without_a_fix_change_nothing_and_are_told() -> None:
    rows = flight(60)
    way, _ = _way(_window(rows, 0, 10))
    nowhere = replace(rows, latitude_deg=np.full(60, np.nan))
    way.extend(nowhere)
    assert way.fault
    assert len(way.times_s) == 10
    way.extend(rows)
    assert not way.fault


def test_a_thread_lays_telemetry_on_the_streams_clock(tmp_path: Path) -> None:
    start_ns = time.time_ns() - 3_000_000_000
    rows = replace(flight(40), start_time_ns=start_ns)
    path = tmp_path / "a.tlog"
    mavlink_tlog.write(path, rows)
    got: list[Track] = []
    told = Telemetry.model_validate({"file": path, "time_offset": {"seconds": 0.5}})
    thread = TelemetryThread(told, Arrivals(start_ns - 10_000_000_000), got.append)
    until_s = time.monotonic() + 5.0
    while not got and time.monotonic() < until_s:
        time.sleep(0.02)
    thread.stop()
    assert float(got[0].times_s[0]) == pytest.approx(10.5, abs=0.1)
