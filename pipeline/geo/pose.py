"""Camera attitude: gimbal angles to a rotation."""

from __future__ import annotations

import math

import numpy as np

from pipeline.messages import FloatArray


def enu_from_camera(yaw_rad: float, pitch_rad: float, roll_rad: float) -> FloatArray:
    """Rotation (3, 3) from the camera frame (x right, y down, z forward) to ENU.

    yaw: clockwise from north. pitch: positive up (-pi/2 looks straight down). roll: positive right side down.
    This is the convention of DJI's gimbal angles.
    """
    sy, cy = math.sin(yaw_rad), math.cos(yaw_rad)
    sp, cp = math.sin(pitch_rad), math.cos(pitch_rad)
    forward = np.array([sy * cp, cy * cp, sp])
    right_level = np.array([cy, -sy, 0.0])
    down_level = np.cross(forward, right_level)
    sr, cr = math.sin(roll_rad), math.cos(roll_rad)
    right = cr * right_level + sr * down_level
    down = cr * down_level - sr * right_level
    return np.stack([right, down, forward], axis=1)
