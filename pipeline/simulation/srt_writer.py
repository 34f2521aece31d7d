"""Telemetry as the subtitles that DJI's later drones write: one cue for each frame."""

from __future__ import annotations

import math
from datetime import datetime, timedelta

import numpy as np

from pipeline.geo.frame import LocalFrame
from pipeline.simulation.flight import Flight


def dji_srt(
    flight: Flight, frame: LocalFrame, start: datetime, takeoff_height_m: float, focal_mm: float | None = None
) -> str:
    """The text of the file. start: UTC of the video's first frame. focal_mm: equivalent, by the diagonal; else none.

    Positions have 9 decimals (0.1 mm), heights 3 and angles 4, so that rounding moves no pixel.
    """
    latitude, longitude = frame.wgs84_from_enu(flight.positions_enu[:, 0], flight.positions_enu[:, 1])
    yaw, pitch, roll = np.degrees(flight.angles_rad).T
    cues: list[str] = []
    focal = "" if focal_mm is None else f"[focal_len: {focal_mm:.2f}] "
    step_s = float(flight.times_s[1] - flight.times_s[0]) if len(flight.times_s) > 1 else 1.0
    for i, begin in enumerate(flight.times_s.tolist()):
        height = flight.positions_enu[i, 2]
        cues.append(
            f"{i + 1}\n{_clock(begin)} --> {_clock(begin + step_s)}\n"
            f'<font size="28">FrameCnt: {i + 1}, DiffTime: {round(1000 * step_s)}ms\n'
            f"{_date(start + timedelta(seconds=begin))}\n"
            f"[iso: 100] [shutter: 1/1000.0] [fnum: 2.8] [ev: 0] [color_md: default] {focal}"
            f"[latitude: {latitude[i]:.9f}] [longitude: {longitude[i]:.9f}] "
            f"[rel_alt: {height - takeoff_height_m:.3f} abs_alt: {height:.3f}] [ct: 5500] "
            f"[gb_yaw: {math.remainder(yaw[i], 360.0):.4f} gb_pitch: {pitch[i]:.4f} "
            f"gb_roll: {roll[i]:.4f}] </font>\n"
        )
    return "\n".join(cues)


def _clock(time_s: float) -> str:
    total_ms = round(time_s * 1000.0)
    seconds, ms = divmod(total_ms, 1000)
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d},{ms:03d}"


def _date(moment: datetime) -> str:
    return f"{moment:%Y-%m-%d %H:%M:%S},{moment.microsecond // 1000:03d},{moment.microsecond % 1000:03d}"
