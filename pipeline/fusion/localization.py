"""Where the person of several looks stands: the paper's average, sharpened by parallax.

The paper averages the points where the looks' significant points meet the ground. For a lying person that
point is the near edge of the body, and it moves as the camera does. But the rays through the *centres* of the
boxes all pass close to the middle of the body, standing or lying: looks from different angles fix it by
triangulation. Both are combined by least squares, so that without parallax (a hovering drone) the estimate is
the paper's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.fusion.look import Look
from pipeline.fusion.voxel_map import log_odds
from pipeline.messages import FloatArray

#: Standard deviations, metres: of the average of the ground points (the bias of lying bodies),
#: and of the bundle of centre rays (the box's centre is not quite the same point of the body from all sides).
GROUND_STD_M = 0.5
RAYS_STD_M = 0.05
#: what the ground points say of the height, as a share of what they say of east and north: rays that all point straight
#: down leave the height of the body open, and the normal equations singular
_HEIGHT_SHARE = 1e-9


@dataclass(frozen=True, eq=False)
class Fix:
    """The middle of a body by least squares, and what each look does to it.

    body_enu: float64 (3,), metres. from_rays, from_ground: float64 (N, 2, 3), how far its east and north move
    for each metre that the centre ray, the ground point of a look moves (east, north, up).
    """

    body_enu: FloatArray
    from_rays: FloatArray
    from_ground: FloatArray


def weights(looks: Sequence[Look]) -> FloatArray:
    """Shares (N,) of the looks, sum 1, by the log-odds that each added to the map."""
    added = log_odds(np.array([look.p for look in looks]))
    return np.asarray(added / added.sum(), dtype=np.float64)


def mean_intersection(looks: Sequence[Look]) -> FloatArray:
    """The paper's estimate (3,): the average of the looks' ground points, weighted by their updates."""
    return np.asarray(weights(looks) @ np.array([look.intersection_enu for look in looks]), dtype=np.float64)


def locate(looks: Sequence[Look]) -> FloatArray:
    """East and north (2,), metres, of the middle of the body."""
    return solve(looks).body_enu[:2]


def solve(looks: Sequence[Look]) -> Fix:
    """The least-squares solution of the looks' rays and of their average ground point."""
    share = weights(looks)[:, None, None]
    rays = np.array([look.center_ray_enu for look in looks])
    cameras = np.array([look.camera_enu for look in looks])
    points = np.array([look.intersection_enu for look in looks])
    across = share * (np.eye(3) - rays[:, :, None] * rays[:, None, :]) / RAYS_STD_M**2
    level = share * np.diag([1.0, 1.0, _HEIGHT_SHARE]) / GROUND_STD_M**2
    normal = (across + level).sum(axis=0)
    from_rays, from_ground = np.linalg.solve(normal, across), np.linalg.solve(normal, level)
    body = np.einsum("nij,nj->i", from_rays, cameras) + np.einsum("nij,nj->i", from_ground, points)
    return Fix(body, from_rays[:, :2], from_ground[:, :2])
