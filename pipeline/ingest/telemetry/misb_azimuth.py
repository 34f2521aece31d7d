"""What the relative angles of a MISB sensor (tags 18, 19, 20) count from, judged by the frame centre beside them.

ST 0601 counts them from the aircraft. Some writers fill in angles from north and the horizon. A literal reader
then misses the frame centre (tags 23, 24) by the aircraft's heading.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from pipeline.errors import InputError
from pipeline.ingest.attitude import camera_on_aircraft
from pipeline.messages import FloatArray

Reading = Literal["relative", "absolute"]
#: bearings of camera and frame centre agree to this: headings are good to a few degrees
_FITS_RAD = math.radians(5.0)
_COMPASS_RAD = math.radians(1.0)
#: below this way to the frame centre, over the way straight down, a bearing says little
_SLANT = 0.25
_RADIUS_M = 6_371_000.0


def azimuth_reading(
    path: object,
    stated: Reading | None,
    aircraft_rad: FloatArray,
    sensor_rad: FloatArray,
    positions: FloatArray,
    centres: FloatArray,
    assumed: list[str],
) -> Reading:
    """The reading that the mission states, or that which fits the frame centres.

    aircraft_rad, sensor_rad: (N, 3). positions, centres: (N, 3), latitude, longitude (degrees), height (m).
    Without a frame centre that could tell, that of the standard, and said so. Raises InputError if neither fits.
    """
    if stated is not None:
        return stated
    bearings, tell = _bearings(positions, centres)
    errors = {
        "relative": _turn(camera_on_aircraft(aircraft_rad, sensor_rad)[:, 0] - bearings)[tell],
        "absolute": _turn(sensor_rad[:, 0] - bearings)[tell],
    }
    median = {
        name: float(np.nanmedian(v)) if np.isfinite(v).any() else math.inf for name, v in errors.items()
    }
    if not any(math.isfinite(v) for v in median.values()):
        assumed.append(
            "tags 18 to 20 count from the aircraft (ST 0601); no frame centre tells otherwise "
            "(telemetry.sensor_azimuth)"
        )
        return "relative"
    # an aircraft that flies nearly north fits both ways: the closer one counts, beyond what a compass is off
    closer = median["relative"] > _COMPASS_RAD and median["absolute"] < 0.5 * median["relative"]
    if median["relative"] <= _FITS_RAD and not closer:
        return "relative"
    said = ", ".join(
        f"{math.degrees(v):.1f} degrees if {name}" for name, v in median.items() if math.isfinite(v)
    )
    if median["absolute"] <= _FITS_RAD:
        assumed.append(
            f"tags 18 to 20 count from north and the horizon, not from the aircraft: they miss the bearing of the "
            f"frame centre by {said} (telemetry.sensor_azimuth: absolute)"
        )
        return "absolute"
    raise InputError(
        path,
        f"camera angles that miss the frame centre of their own packets by {said}",
        "telemetry.sensor_azimuth: relative (to the aircraft) or absolute (to north)",
    )


def _bearings(positions: FloatArray, centres: FloatArray) -> tuple[FloatArray, np.ndarray]:
    """Bearing from the sensor to the frame centre (N,), radians, and whether it can tell a reading."""
    wide = np.cos(np.radians(positions[:, 0]))
    north_m = np.radians(centres[:, 0] - positions[:, 0]) * _RADIUS_M
    turn = np.mod(centres[:, 1] - positions[:, 1] + 180.0, 360.0) - 180.0
    east_m = np.radians(turn) * wide * _RADIUS_M
    # the centre's height is often missing, or that of a flat world: what is over it is at most the sensor's height
    above_m = np.abs(np.where(np.isfinite(centres[:, 2]), positions[:, 2] - centres[:, 2], positions[:, 2]))
    away_m = np.hypot(north_m, east_m)
    tell = np.isfinite(away_m) & (away_m > _SLANT * np.nan_to_num(above_m)) & (away_m > 1.0)
    return np.arctan2(east_m, north_m), tell


def _turn(angles_rad: FloatArray) -> FloatArray:
    return np.abs(np.mod(angles_rad + math.pi, 2.0 * math.pi) - math.pi)
