"""Where the camera of one stream was at any time of its video, how surely, and what time it was."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.geo.pose import enu_from_camera
from pipeline.ingest.between_samples import BetweenSamples, between_samples
from pipeline.ingest.track import Clock
from pipeline.messages import CameraPose, FloatArray

#: from here on yaw and roll are nearly one turn
_STEEP_RAD = math.radians(80.0)
#: a time written in milliseconds must not fail by its rounding in binary, seconds
_ROUNDING_S = 1e-6


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Samples in the map frame on the video's clock; ``trajectory_of`` makes it from a track.

    times_s: float64 (N,), N >= 1, increasing, time of the video. positions_enu: (N, 3), metres, heights above the
    terrain's datum. angles_rad: (N, 3), yaw, pitch and roll of the camera. sds: (N, 3), standard deviations that
    the telemetry states: horizontal (m, each axis), height (m), attitude (rad); NaN where it states none.
    focal_scale: (N,), focal length over that of the stream's camera. mission_sds: (3,), what the mission takes those
    to be that the telemetry does not state; where an error is added to one, it is added to this.

    end_s: until then the last sample is carried on. longest_gap_s: between samples that a pose may lie in.
    start_ns: date of the video's time 0, ns since 1970 on ``clock``. assumed: what had to be, a sentence each.
    takeoff_m: height of the place where the aircraft took off, above the terrain's datum; NaN where no height above it
    is told.
    """

    times_s: FloatArray
    positions_enu: FloatArray
    angles_rad: FloatArray
    sds: FloatArray
    focal_scale: FloatArray
    end_s: float
    longest_gap_s: float
    start_ns: int
    clock: Clock
    assumed: tuple[str, ...] = ()
    mission_sds: FloatArray = field(default_factory=lambda: np.full(3, math.nan))
    takeoff_m: float = math.nan

    @property
    def span_s(self) -> tuple[float, float]:
        """The first time of the video for which there is a sample, and the time until which the last one holds."""
        return float(self.times_s[0]), self.end_s

    def utc_ns(self, time_s: float) -> int:
        """Date (ns since 1970, on ``clock``) of a time of the video."""
        return self.start_ns + round(time_s * 1e9)

    def pose(self, time_s: float) -> CameraPose | None:
        """The camera's pose at a time of the video, linear between the samples around it; None if there is none.

        Angles turn the shorter way, through straight down too. There is none more than half a sample before the
        first one, after ``end_s``, and between samples that are farther apart than the longest gap. Between two samples
        it is less sure, by as much as the samples around them say that the motion changed (``between_samples``). After
        the last sample the position goes on as it moved, and is surer by nothing: half of that way is added to its
        standard deviation.
        """
        place = self._between(time_s)
        if place is None:
            return None
        index, share = place
        following = min(index + 1, len(self.times_s) - 1)
        position = _mixed(self.positions_enu[index], self.positions_enu[following], share)
        attitude = _turned(self.angles_rad[index], self.angles_rad[following], min(max(share, 0.0), 1.0))
        horizontal_m, height_m, attitude_rad = _mixed(
            self.sds[index], self.sds[following], min(max(share, 0.0), 1.0)
        )
        carried_m = max(0.0, share - 1.0, -share) * np.abs(
            self.positions_enu[following] - self.positions_enu[index]
        )
        if carried_m.any():
            added_m = 0.5 * np.array([math.hypot(carried_m[0], carried_m[1]), carried_m[2]])
            horizontal_m, height_m = widened(
                np.array([horizontal_m, height_m]), self.mission_sds[:2], added_m
            )
        elif 0.0 < share < 1.0 and (added := self._changes.at(index, share)).any():
            horizontal_m, height_m, attitude_rad = widened(
                np.array([horizontal_m, height_m, attitude_rad]), self.mission_sds, added
            )
        scale = _mixed(self.focal_scale[index], self.focal_scale[following], 0.0 if share < 1.0 else 1.0)
        return CameraPose(
            position,
            attitude,
            float(horizontal_m),
            float(height_m),
            float(attitude_rad),
            float(scale),
        )

    def covers(self, times_s: FloatArray) -> NDArray[np.bool_]:
        """Whether there is a pose at each time (N,) of the video."""
        own, half_s = self.times_s, self._half_s
        inside = (times_s >= own[0] - half_s - _ROUNDING_S) & (times_s <= self.end_s + _ROUNDING_S)
        if len(own) == 1:
            return inside
        before = np.clip(np.searchsorted(own, times_s, side="right") - 1, 0, len(own) - 2)
        wide = own[before + 1] - own[before] > self.longest_gap_s
        return inside & ~(wide & (times_s > own[before] + half_s) & (times_s < own[before + 1] - half_s))

    @cached_property
    def _changes(self) -> BetweenSamples:
        return between_samples(self.times_s, self.positions_enu, self.angles_rad, self.longest_gap_s)

    @cached_property
    def _half_s(self) -> float:
        """Half of the usual time between two samples."""
        return 0.5 * float(np.median(np.diff(self.times_s))) if len(self.times_s) > 1 else 0.0

    def _between(self, time_s: float) -> tuple[int, float] | None:
        """The sample before a time, and how far it is to the next one: 0..1, outside of that beyond the ends."""
        times, half_s = self.times_s, self._half_s
        if not times[0] - half_s - _ROUNDING_S <= time_s <= self.end_s + _ROUNDING_S:
            return None
        if len(times) == 1:
            return 0, 0.0
        index = min(max(int(np.searchsorted(times, time_s, side="right")) - 1, 0), len(times) - 2)
        gap_s = float(times[index + 1] - times[index])
        if gap_s > self.longest_gap_s and times[index] + half_s < time_s < times[index + 1] - half_s:
            return None
        return index, (time_s - float(times[index])) / gap_s


def _turned(before_rad: FloatArray, after_rad: FloatArray, share: float) -> FloatArray:
    """Rotation (3, 3) between two attitudes.

    A gimbal pans about the vertical and tilts for itself, so yaw, pitch and roll go on for themselves, the shorter
    way. Near straight down a yaw and a roll of half a turn each are none: there it is one turn about one axis.
    """
    first, second = before_rad.tolist(), after_rad.tolist()
    if max(abs(first[1]), abs(second[1])) < _STEEP_RAD:
        turns = [math.remainder(b - a, 2.0 * math.pi) for a, b in zip(first, second, strict=True)]
        return enu_from_camera(*(a + share * turn for a, turn in zip(first, turns, strict=True)))
    before, after = enu_from_camera(*first), enu_from_camera(*second)
    axis_angle = Rotation.from_matrix(before.T @ after).as_rotvec()
    return np.asarray(before @ Rotation.from_rotvec(share * axis_angle).as_matrix())


def _mixed(before: FloatArray, after: FloatArray, share: float) -> FloatArray:
    return np.asarray(before + share * (after - before))


def widened(sds: FloatArray, mission_sds: FloatArray | float, added: FloatArray | float) -> FloatArray:
    """Deviations with an independent error more: of what is stated, or else of what the mission says."""
    return np.hypot(np.where(np.isnan(sds), np.nan_to_num(mission_sds), sds), added)
