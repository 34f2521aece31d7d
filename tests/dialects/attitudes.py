"""Attitudes for the writers, by the rotation of ``pipeline.geo.pose`` and numpy only, apart from the readers' code."""

from __future__ import annotations

import math

import numpy as np

from pipeline.geo.pose import enu_from_camera


def relative_angles(
    camera_rad: tuple[float, float, float], aircraft_rad: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Yaw, pitch and roll of a camera as turned on an aircraft."""
    level = enu_from_camera(0.0, 0.0, 0.0)
    # camera in the aircraft's axes, then as if those were east, north and up
    turned = level @ (enu_from_camera(*aircraft_rad).T @ enu_from_camera(*camera_rad))
    return angles(turned)


def angles(enu: np.ndarray) -> tuple[float, float, float]:
    """Yaw, pitch and roll of a rotation from camera (right, down, forward) to east, north, up."""
    right, down, forward = enu.T
    yaw = math.atan2(forward[0], forward[1])
    pitch = math.asin(max(-1.0, min(1.0, forward[2])))
    return yaw, pitch, math.atan2(-right[2], -down[2])


def quaternion(yaw: float, pitch: float, roll: float) -> tuple[float, float, float, float]:
    """w, x, y, z of yaw, pitch and roll about down, right, forward."""
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    return (
        cy * cp * cr + sy * sp * sr,
        cy * cp * sr - sy * sp * cr,
        cy * sp * cr + sy * cp * sr,
        sy * cp * cr - cy * sp * sr,
    )


def aircraft_of(yaw_rad: float) -> tuple[float, float, float]:
    """An attitude for an aircraft whose camera looks along yaw_rad: nose elsewhere, not level."""
    return yaw_rad - math.radians(37.0), math.radians(6.0), math.radians(-4.0)
