"""Attitudes of aircraft and gimbals over time: composed, between samples, from quaternions.

Angles are (N, 3): yaw, pitch, roll, radians. Yaw turns clockwise from north, pitch up is positive, roll with the
right side down is positive, applied in this order (intrinsic z-y'-x'' about forward, right, down). It is the
convention of aircraft and of ``pipeline.geo.pose`` alike: a camera at zero looks out of the nose, level.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from pipeline.messages import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Attitudes:
    """times_s: (N,). angles_rad: (N, 3), NaN where unknown."""

    times_s: FloatArray
    angles_rad: FloatArray

    def ordered(self) -> Attitudes:
        """The known ones in order of time, each time once."""
        known = np.isfinite(self.angles_rad).all(axis=1) & np.isfinite(self.times_s)
        times_s, first = np.unique(self.times_s[known], return_index=True)
        return Attitudes(times_s, self.angles_rad[known][first])

    def at(self, times_s: FloatArray, longest_gap_s: float) -> FloatArray:
        """Angles (M, 3) at given times, turned the shortest way between samples.

        NaN before the first and after the last one, and between two that are farther apart than the gap.
        """
        own = self.ordered()
        result = np.full((len(times_s), 3), math.nan)
        if len(own.times_s) == 0:
            return result
        after = np.clip(np.searchsorted(own.times_s, times_s), 1, max(len(own.times_s) - 1, 1))
        inside = (times_s >= own.times_s[0]) & (times_s <= own.times_s[-1])
        if len(own.times_s) == 1:
            result[inside] = own.angles_rad[0]
            return result
        near = own.times_s[after] - own.times_s[after - 1] <= longest_gap_s
        wanted = inside & (near | np.isin(times_s, own.times_s))
        if wanted.any():
            turned = Slerp(own.times_s, rotations(own.angles_rad))(times_s[wanted])
            result[wanted] = angles_of(turned)
        return result


def rotations(angles_rad: FloatArray) -> Rotation:
    """Rotations from forward, right, down to north, east, down; angles (N, 3) must be finite."""
    return Rotation.from_euler("ZYX", angles_rad)


def angles_of(rotation: Rotation) -> FloatArray:
    """Yaw, pitch, roll (N, 3). Straight down or up, where yaw and roll are one turn, roll is 0."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # scipy names the gimbal lock that we resolve as it does
        return np.asarray(rotation.as_euler("ZYX"), np.float64).reshape(-1, 3)


def camera_on_aircraft(aircraft_rad: FloatArray, relative_rad: FloatArray) -> FloatArray:
    """Angles (N, 3) of a camera that is turned by relative angles (N, 3) on an aircraft of angles (N, 3)."""
    result = np.full(np.shape(relative_rad), math.nan)
    known = np.isfinite(aircraft_rad).all(axis=1) & np.isfinite(relative_rad).all(axis=1)
    if known.any():
        result[known] = angles_of(rotations(aircraft_rad[known]) * rotations(relative_rad[known]))
    return result


def angles_of_quaternions(quaternions: FloatArray) -> FloatArray:
    """Angles (N, 3) of quaternions (N, 4), w first, from forward, right, down; NaN for what is no rotation."""
    result = np.full((len(quaternions), 3), math.nan)
    norms = np.linalg.norm(quaternions, axis=1)
    # a log writes unit quaternions as 32-bit floats; zeros and garbage are none
    known = np.isfinite(norms) & (np.abs(norms - 1.0) < 0.1)
    if known.any():
        result[known] = angles_of(Rotation.from_quat(quaternions[known][:, [1, 2, 3, 0]]))
    return result
