"""Where the camera of one stream was at any time of its video, how surely, and what time it was."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.config.mission import Datum, Telemetry
from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.ingest.track import Clock, Track
from pipeline.messages import CameraPose, FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A track as a mission uses it: in the map frame, on the video's clock, above the terrain's datum."""

    track: Track
    telemetry: Telemetry
    frame: LocalFrame
    terrain_datum: Datum

    @property
    def clock(self) -> Clock:
        """What utc_ns counts on."""
        return self.track.clock

    @property
    def span_s(self) -> tuple[float, float]:
        """The first and the last time of the video for which there is a sample."""
        offset_s = self.telemetry.time_offset
        return float(self.track.times_s[0]) + offset_s, float(self.track.times_s[-1]) + offset_s

    def utc_ns(self, time_s: float) -> int:
        """Date (ns since 1970, on ``clock``) of a time of the video."""
        since_first_s = time_s - self.telemetry.time_offset - float(self.track.times_s[0])
        return self.track.start_time_ns + round(since_first_s * 1e9)

    def pose(self, time_s: float) -> CameraPose | None:
        """The camera's pose at a time of the video, linear between the samples around it; None if there is none.

        Angles turn the shorter way. There is none more than half a sample before the first or after the last
        one. Raises InputError if the height above the terrain's datum cannot be told.
        """
        place = self._between(time_s - self.telemetry.time_offset)
        if place is None:
            return None
        index, share = place
        track = self.track
        latitude, longitude = (_linear(v, index, share) for v in (track.latitude_deg, track.longitude_deg))
        east, north = self.frame.enu_from_wgs84(np.asarray(latitude), np.asarray(longitude))
        attitude = enu_from_camera(
            _angle(track.yaw_rad, index, share),
            _angle(track.pitch_rad, index, share),
            _angle(track.roll_rad, index, share),
        )
        height = self._height_m(index, share)
        return CameraPose(np.array([float(east), float(north), height]), attitude)

    def _between(self, sample_time_s: float) -> tuple[int, float] | None:
        """The sample before a time, and how far (0..1) to the next one; the ends are held for half a sample."""
        times = self.track.times_s
        half_s = 0.5 * float(np.median(np.diff(times))) if len(times) > 1 else 0.0
        # a microsecond more: a time written in milliseconds must not fail by its rounding in binary
        if not times[0] - half_s - 1e-6 <= sample_time_s <= times[-1] + half_s + 1e-6:
            return None
        if len(times) == 1:
            return 0, 0.0
        index = min(max(int(np.searchsorted(times, sample_time_s, side="right")) - 1, 0), len(times) - 2)
        share = (sample_time_s - times[index]) / (times[index + 1] - times[index])
        return index, min(max(float(share), 0.0), 1.0)

    def _height_m(self, index: int, share: float) -> float:
        """Height above the terrain's datum: h (ellipsoid) = H (geoid) + N (undulation)."""
        telemetry, track = self.telemetry, self.track
        relative = telemetry.height == "relative"
        height = _linear(track.relative_height_m if relative else track.absolute_height_m, index, share)
        if math.isnan(height):
            other = "absolute" if relative else "relative"
            raise InputError(
                telemetry.file, f"telemetry without {telemetry.height} height", f"it, or height: {other}"
            )
        if relative:
            if telemetry.takeoff_height is None:
                raise InputError(telemetry.file, "heights above an unknown take-off point", "takeoff_height")
            height += telemetry.takeoff_height
        datum = telemetry.height_datum or track.height_datum or "ellipsoid"
        if datum == self.terrain_datum:
            return height
        if telemetry.geoid_undulation is None:
            found = f"heights above the {datum} and a terrain above the {self.terrain_datum}"
            raise InputError(telemetry.file, found, "geoid_undulation in the stream's telemetry")
        return height + telemetry.geoid_undulation * (1.0 if self.terrain_datum == "ellipsoid" else -1.0)


def require_complete(track: Track, path: object) -> None:
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


def _linear(values: FloatArray, index: int, share: float) -> float:
    following = values[min(index + 1, len(values) - 1)]
    return float(values[index] + share * (following - values[index]))


def _angle(values: FloatArray, index: int, share: float) -> float:
    following = float(values[min(index + 1, len(values) - 1)])
    turn = math.remainder(following - float(values[index]), 2.0 * math.pi)
    return float(values[index]) + share * turn
