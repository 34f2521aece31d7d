"""How surely a box says where its person stands: the covariance of one look on the ground.

First-order propagation, as in ``error_propagation`` but for one look alone. Two widths, since they do different
things to the map:

- *noise* differs from look to look (the wandering of position and attitude, the box). It widens what a look raises.
- *total* is noise and what all looks of a stream share (biases, the focal length, the terrain's height, the body).
  A shared error moves all looks of a stream alike, so it must not widen what they raise; it goes into the error
  ellipse. But another stream has another one, and would lower the very place where this one found somebody: a
  frame with a box lowers nothing where the person of the box may stand.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from pipeline.config.uncertainty import Uncertainty
from pipeline.messages import CameraPose, FloatArray


def look_covariances(
    hits_enu: FloatArray, pose: CameraPose, uncertainty: Uncertainty, pixel_rad: float, focal_sd: float
) -> tuple[FloatArray, FloatArray]:
    """Noise and total covariances (N, 2, 2) of east and north, square metres, of ground points (N, 3).

    pixel_rad: the angle that a pixel covers. focal_sd: of the focal length, as a share of it. What the pose states
    of its own errors takes the place of the mission's biases.
    """
    horizontal = _stated(pose.horizontal_sd_m, uncertainty.position_bias)
    vertical = _stated(pose.height_sd_m, uncertainty.height_bias)
    attitude = _stated(pose.attitude_sd_rad, uncertainty.attitude_bias)
    noise = (uncertainty.position_noise**2, uncertainty.position_noise**2, uncertainty.attitude_noise**2)
    shared = (horizontal**2, math.hypot(vertical, uncertainty.terrain) ** 2, attitude**2)
    angular = (uncertainty.box * pixel_rad) ** 2, focal_sd**2, uncertainty.body**2
    return _propagate(hits_enu, pose.position_enu, pose.enu_from_camera, noise, shared, angular)


def _stated(stated: float, of_mission: float) -> float:
    return of_mission if math.isnan(stated) else stated


@numba.njit(cache=True, error_model="numpy")
def _propagate(hits, camera, enu_from_camera, noise, shared, angular):  # type: ignore[no-untyped-def]
    """noise, shared: variances of horizontal position, of height, of attitude. angular: of the box's direction,
    of the focal length's share, and of the body on the ground.
    """
    box, focal, body = angular
    count = hits.shape[0]
    wandering, total = np.empty((count, 2, 2)), np.empty((count, 2, 2))
    forward = enu_from_camera[:, 2]
    for i in range(count):
        sight = hits[i] - camera
        turns, up = _turns(sight), -sight[:2] / sight[2]
        along = sight[0] * forward[0] + sight[1] * forward[1] + sight[2] * forward[2]
        across = along * forward - sight  # the focal length gathers what is across the axis
        spread = across[:2] + across[2] * up
        wandering[i] = noise[0] * np.eye(2) + noise[1] * np.outer(up, up) + (noise[2] + box) * turns
        total[i] = (shared[0] + body) * np.eye(2) + shared[1] * np.outer(up, up) + shared[2] * turns
        total[i] += wandering[i] + focal * np.outer(spread, spread)
    return wandering, total


@numba.njit(cache=True, error_model="numpy")
def _turns(sight):  # type: ignore[no-untyped-def]
    """Covariance (2, 2) of where a line of sight (3,) meets level ground, for turns of a radian about each axis.

    A turn by the small vector a moves the far end by a x sight, which then slides along the sight to the ground.
    """
    x, y, z = sight
    east = (-x * y / z, z + x * x / z, -y)
    north = (-z - y * y / z, x * y / z, x)
    a = east[0] * east[0] + east[1] * east[1] + east[2] * east[2]
    b = east[0] * north[0] + east[1] * north[1] + east[2] * north[2]
    c = north[0] * north[0] + north[1] * north[1] + north[2] * north[2]
    return np.array([[a, b], [b, c]])
