"""Where a camera was: telemetry samples, and the pose at any time between them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.config.mission import Datum, Telemetry
from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.messages import CameraPose, FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """N >= 1 samples; every array is float64 (N,), all NaN where the format lacks the field.

    start_time_ns: UTC of the first sample, 0 where the format has no date. times_s: since the video's start,
    increasing. latitude_deg, longitude_deg: WGS84. absolute_height_m: above the ellipsoid or the geoid; the
    file does not say which. relative_height_m: above the take-off point. yaw_rad, pitch_rad, roll_rad: the
    camera's, as in ``pipeline.geo.pose``.
    """

    start_time_ns: int
    times_s: FloatArray
    latitude_deg: FloatArray
    longitude_deg: FloatArray
    absolute_height_m: FloatArray
    relative_height_m: FloatArray
    yaw_rad: FloatArray
    pitch_rad: FloatArray
    roll_rad: FloatArray


def require_complete(track: Track, path: Path) -> None:
    """Raises InputError if the track cannot give a pose: positions or gimbal angles are missing."""
    for name, values in (
        ("position", track.latitude_deg),
        ("gimbal yaw", track.yaw_rad),
        ("gimbal pitch", track.pitch_rad),
        ("gimbal roll", track.roll_rad),
    ):
        if np.isnan(values).any():
            expected = "latitude, longitude, gb_yaw, gb_pitch and gb_roll in every sample"
            raise InputError(path, f"telemetry without {name}", expected)


def utc_ns(track: Track, time_s: float, telemetry: Telemetry) -> int:
    """UTC (ns) of a time of the video."""
    since_first_s = time_s - telemetry.time_offset - float(track.times_s[0])
    return track.start_time_ns + round(since_first_s * 1e9)


def pose_at(
    track: Track, time_s: float, telemetry: Telemetry, frame: LocalFrame, terrain_datum: Datum
) -> CameraPose:
    """The camera's pose in the map frame at a time of the video, linear between the samples around it.

    Angles turn the shorter way. Raises InputError more than half a sample before the first or after the last
    one, and if the height above the terrain's datum cannot be told.
    """
    index, share = _between(track, time_s - telemetry.time_offset, time_s, telemetry.file)
    latitude, longitude = (
        _linear(track.latitude_deg, index, share),
        _linear(track.longitude_deg, index, share),
    )
    east, north = frame.enu_from_wgs84(np.asarray(latitude), np.asarray(longitude))
    attitude = enu_from_camera(
        _angle(track.yaw_rad, index, share),
        _angle(track.pitch_rad, index, share),
        _angle(track.roll_rad, index, share),
    )
    height = _height_m(track, index, share, telemetry, terrain_datum)
    return CameraPose(np.array([float(east), float(north), height]), attitude)


def _between(track: Track, sample_time_s: float, video_time_s: float, path: Path) -> tuple[int, float]:
    """The sample before a time, and how far (0..1) to the next one; the ends are held for half a sample."""
    times = track.times_s
    half_s = 0.5 * float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    first, last = float(times[0]), float(times[-1])
    # a microsecond more: a time written in milliseconds must not fail by its rounding in binary
    if not first - half_s - 1e-6 <= sample_time_s <= last + half_s + 1e-6:
        shift = video_time_s - sample_time_s
        found = f"telemetry from {first + shift:.3f} s to {last + shift:.3f} s of the video"
        raise InputError(path, found, f"telemetry at {video_time_s:.3f} s too")
    if len(times) == 1:
        return 0, 0.0
    index = min(max(int(np.searchsorted(times, sample_time_s, side="right")) - 1, 0), len(times) - 2)
    share = (sample_time_s - times[index]) / (times[index + 1] - times[index])
    return index, min(max(float(share), 0.0), 1.0)


def _linear(values: FloatArray, index: int, share: float) -> float:
    following = values[min(index + 1, len(values) - 1)]
    return float(values[index] + share * (following - values[index]))


def _angle(values: FloatArray, index: int, share: float) -> float:
    following = float(values[min(index + 1, len(values) - 1)])
    turn = math.remainder(following - float(values[index]), 2.0 * math.pi)
    return float(values[index]) + share * turn


def _height_m(track: Track, index: int, share: float, telemetry: Telemetry, terrain_datum: Datum) -> float:
    """Height above the terrain's datum: h (ellipsoid) = H (geoid) + N (undulation)."""
    relative = telemetry.height == "relative"
    height = _linear(track.relative_height_m if relative else track.absolute_height_m, index, share)
    if math.isnan(height):
        other = "absolute" if relative else "relative"
        raise InputError(
            telemetry.file, f"telemetry without {telemetry.height} height", f"it, or height: {other}"
        )
    if relative:
        height += telemetry.takeoff_height or 0.0
    if telemetry.height_datum == terrain_datum:
        return height
    if telemetry.geoid_undulation is None:
        found = f"heights above the {telemetry.height_datum} and a terrain above the {terrain_datum}"
        raise InputError(telemetry.file, found, "geoid_undulation in the stream's telemetry")
    return height + telemetry.geoid_undulation * (1.0 if terrain_datum == "ellipsoid" else -1.0)
