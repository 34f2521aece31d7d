"""What MAVLink messages and PX4 topics say of a gimbal, as angles from north and the horizon.

``GIMBAL_DEVICE_ATTITUDE_STATUS``: a quaternion; roll and pitch from the horizon; its flags say whether yaw counts
from north or from the vehicle's heading (where they do not, a locked yaw counts from north).
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.ingest.attitude import Attitudes, angles_of_quaternions
from pipeline.messages import FloatArray

YAW_LOCK, YAW_IN_VEHICLE_FRAME, YAW_IN_EARTH_FRAME = 16, 32, 64


def device_attitudes(
    times_s: FloatArray,
    flags: FloatArray,
    quaternions: FloatArray,
    aircraft: Attitudes | None,
    longest_gap_s: float,
) -> Attitudes:
    """The camera's attitudes of a gimbal device; NaN where the heading that they count from is not known."""
    angles = angles_of_quaternions(quaternions)
    bits = np.nan_to_num(flags).astype(np.int64)
    said = (bits & (YAW_IN_VEHICLE_FRAME | YAW_IN_EARTH_FRAME)) != 0
    from_north = np.where(said, (bits & YAW_IN_EARTH_FRAME) != 0, (bits & YAW_LOCK) != 0)
    heading = heading_at(times_s, aircraft, longest_gap_s)
    angles[:, 0] += np.where(from_north, 0.0, heading)
    return Attitudes(times_s, angles)


def heading_at(times_s: FloatArray, aircraft: Attitudes | None, longest_gap_s: float) -> FloatArray:
    """The vehicle's heading (N,), radians, NaN where unknown."""
    if aircraft is None:
        return np.full(len(times_s), math.nan)
    return aircraft.at(times_s, longest_gap_s)[:, 0]
