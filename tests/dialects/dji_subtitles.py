"""A track as the subtitles of DJI's drones, each in its own words and to its own decimals."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from pipeline.ingest.track import Track

#: the text of sample i
Text = Callable[[Track, int], str]


def write(path: Path, rows: Track, text: Text, encoding: str = "utf-8", line_end: str = "\n") -> None:
    """Every row of the track as a cue that lasts until the next one."""
    cues = (
        f"{i + 1}\n{_clock(begin)} --> {_clock(end)}\n{words}\n\n"
        for i, (begin, end, words) in enumerate(cues_of(rows, text))
    )
    path.write_bytes("".join(cues).replace("\n", line_end).encode(encoding))


def cues_of(rows: Track, text: Text) -> Iterator[tuple[float, float, str]]:
    """Begin and end, seconds of the video, and words of every cue."""
    times = rows.times_s.tolist()
    step_s = float(np.median(np.diff(rows.times_s))) if len(times) > 1 else 1.0
    for i, (begin, end) in enumerate(zip(times, [*times[1:], times[-1] + step_s], strict=True)):
        yield begin, end, text(rows, i)


def brackets(rows: Track, i: int) -> str:
    """Mavic 2 and later, the enterprise drones: everything that a map needs, nine decimals."""
    yaw, pitch, roll = _angles_deg(rows, i)
    return (
        f'<font size="28">FrameCnt: {i + 1}, DiffTime: 33ms\n{_date(rows, i):%Y-%m-%d %H:%M:%S,%f},000\n'
        "[iso : 100] [shutter : 1/1000.0] [fnum : 280] [ev : 0] [ct : 5500] [color_md : default] [focal_len : 240] "
        f"[dzoom_ratio: 10000, delta:0], [latitude: {rows.latitude_deg[i]:.9f}] "
        f"[longitude: {rows.longitude_deg[i]:.9f}] [rel_alt: {rows.relative_height_m[i]:.3f} "
        f"abs_alt: {rows.absolute_height_m[i]:.3f}] [gb_yaw: {yaw:.4f} gb_pitch: {pitch:.4f} gb_roll: {roll:.4f}] "
        "</font>"
    )


def pitch_roll_yaw(rows: Track, i: int) -> str:
    """Matrice 300 with an H20: satellites, height above take-off, angles of aircraft and gimbal."""
    yaw, pitch, roll = _angles_deg(rows, i)
    return (
        f"F/2.8, SS 400, ISO 100, EV 0, DZOOM 1.0, GPS ({rows.longitude_deg[i]:.9f}, {rows.latitude_deg[i]:.9f}, 21), "
        f"D 80.50m, H {rows.relative_height_m[i]:.2f}m, H.S 3.20m/s, V.S 0.00m/s, "
        f"F.PRY (1.2, -0.5, {yaw:.1f}), G.PRY ({pitch:.1f}, {roll:.1f}, {yaw:.1f})"
    )


def rtk(rows: Track, i: int) -> str:
    """Phantom 4 RTK: degree signs, eight decimals, height above take-off."""
    yaw, pitch, roll = _angles_deg(rows, i)
    at = f"{rows.longitude_deg[i]:.8f}, {rows.latitude_deg[i]:.8f}"
    return (
        f"F/6.3, SS 60, ISO 100, EV 0, RTK ({at}, 28), HOME ({at}, 103.55m), D 75.36m, "
        f"H {rows.relative_height_m[i]:.2f}m, H.S 0.30m/s, V.S 0.00m/s, F.PRY (-5.3°, 2.1°, {yaw:.1f}°), "
        f"G.PRY ({pitch:.1f}°, {roll:.1f}°, {yaw:.1f}°)"
    )


def barometer(rows: Track, i: int) -> str:
    """Mavic Pro: four decimals, no angles, local time in whole seconds."""
    at = f"{rows.longitude_deg[i]:.4f},{rows.latitude_deg[i]:.4f}"
    return (
        f"HOME({at}) {_date(rows, i):%Y.%m.%d %H:%M:%S}\nGPS({at},16) BAROMETER:{rows.relative_height_m[i]:.1f}\n"
        "ISO:100 Shutter:60 EV: Fnum:2.2"
    )


def whole_metres(rows: Track, i: int) -> str:
    """Coarser than any drone that we know: four decimals, whole metres, whole degrees."""
    yaw, pitch, roll = _angles_deg(rows, i)
    return (
        f"GPS ({rows.longitude_deg[i]:.4f}, {rows.latitude_deg[i]:.4f}, 14), D 80m, "
        f"H {rows.relative_height_m[i]:.0f}m, G.PRY ({pitch:.0f}, {roll:.0f}, {yaw:.0f})"
    )


def _angles_deg(rows: Track, i: int) -> tuple[float, float, float]:
    yaw, pitch, roll = (math.degrees(v[i]) for v in (rows.yaw_rad, rows.pitch_rad, rows.roll_rad))
    return math.remainder(yaw, 360.0), pitch, roll


def _date(rows: Track, i: int) -> datetime:
    return datetime.fromtimestamp(rows.start_time_ns / 1e9 + float(rows.times_s[i] - rows.times_s[0]), UTC)


def _clock(time_s: float) -> str:
    seconds, ms = divmod(round(time_s * 1000.0), 1000)
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d},{ms:03d}"
