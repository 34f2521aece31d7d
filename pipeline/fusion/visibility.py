"""Which surface cells a camera sees: a horizon sweep in azimuth over the terrain.

A cell is seen if a part of the surface over it lies in the picture and no surface hides it. The surface is the terrain's
bilinear one, the same that detections are intersected with. Cells of unknown height neither hide nor are seen.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.fusion.visibility_kernels import in_picture, observe, sweep
from pipeline.geo.camera import Camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, FloatArray

#: Distance of neighbouring azimuths at the far end, and of samples along one, in cells.
_AZIMUTH_SPACING = 0.5
_STEP = 0.5
_FEWEST_AZIMUTHS = 64

IntArray = NDArray[np.int64]


def visible_cells(
    terrain: Terrain,
    camera: Camera,
    pose: CameraPose,
    max_distance_m: float,
    excluded_boxes_px: FloatArray,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows (N,), columns (N,) and distances (N,) in metres of the seen cells, each once, in a fixed order.

    A cell counts up to max_distance_m, measured to its centre. Cells whose centre projects into one of the boxes (M, 4)
    x0, y0, x1, y1 are left out: they lie behind what was detected. The camera may stand outside the terrain.
    """
    position = np.array(
        [
            (pose.position_enu[0] - terrain.east_m) / terrain.cell_m,
            (pose.position_enu[1] - terrain.north_m) / terrain.cell_m,
            pose.position_enu[2],
        ]
    )
    rays = _border_rays(camera) @ pose.enu_from_camera.T
    near_m, far_m = _reach(terrain, rays, float(pose.position_enu[2]), max_distance_m)
    first, width = _azimuths(rays, pose.enu_from_camera[:, 2])
    if _sees_a_pole(camera, pose):
        near_m, first, width = 0.0, 0.0, 2.0 * math.pi
    near, far = near_m / terrain.cell_m, far_m / terrain.cell_m
    corner, shape = _window(terrain, position, far)
    if min(shape) <= 0:
        return np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
    count = max(math.ceil(width * far / _AZIMUTH_SPACING), _FEWEST_AZIMUTHS)
    stamps = np.zeros(shape, dtype=np.uint8)
    cells = np.empty((stamps.size, 2), dtype=np.int64)
    toward_camera = pose.enu_from_camera.T * np.array([terrain.cell_m, terrain.cell_m, 1.0])
    lens, heights = _lens(camera), terrain.heights_m
    found = sweep(
        heights, position, first, width / count, count + 1, near, far, _STEP, toward_camera, lens, stamps, corner, cells
    )
    cells, distances = cells[:found], np.empty(found)
    boxes = np.ascontiguousarray(excluded_boxes_px, dtype=np.float64).reshape(-1, 4)
    kept = observe(
        heights, position, terrain.cell_m, toward_camera, lens, boxes, max_distance_m, cells, distances
    )
    return cells[:kept, 0], cells[:kept, 1], distances[:kept]


@lru_cache(maxsize=64)
def _border_rays(camera: Camera) -> FloatArray:
    """Directions (N, 3) in the camera frame of the picture's border, a pixel apart."""
    w, h = float(camera.width), float(camera.height)
    across, down = np.arange(camera.width + 1.0), np.arange(camera.height + 1.0)
    sides = [
        np.stack([across, np.zeros_like(across)], axis=1),
        np.stack([across, np.full_like(across, h)], axis=1),
        np.stack([np.zeros_like(down), down], axis=1),
        np.stack([np.full_like(down, w), down], axis=1),
    ]
    return camera.rays(np.concatenate(sides))


@lru_cache(maxsize=64)
def _lens(camera: Camera) -> FloatArray:
    """The kernels' lens (12,): the camera's numbers and the greatest squared radius of a pixel."""
    border = _border_rays(camera)
    r2_max = float((border[:, 0] ** 2 + border[:, 1] ** 2).max()) * (1.0 + 1e-9)
    return np.array(
        [camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height, *camera.distortion, r2_max]
    )


@lru_cache(maxsize=8)
def _height_range(terrain: Terrain) -> tuple[float, float]:
    return float(np.nanmin(terrain.heights_m)), float(np.nanmax(terrain.heights_m))


def _reach(terrain: Terrain, rays: FloatArray, height_m: float, max_distance_m: float) -> tuple[float, float]:
    """Horizontal distances between which the picture can meet the surface, of its border's rays (N, 3).

    Nearer, every ray of the picture is still above the highest cell; farther, below the lowest.
    """
    lowest, highest = _height_range(terrain)
    falls = rays[:, 2] < 0.0
    if not falls.any():
        return 0.0, max_distance_m
    away_per_metre_down = np.hypot(rays[falls, 0], rays[falls, 1]) / -rays[falls, 2]
    near = max(height_m - highest, 0.0) * float(away_per_metre_down.min())
    if not falls.all():
        return near, max_distance_m
    far = max(height_m - lowest, 0.0) * float(away_per_metre_down.max())
    return near, min(far, max_distance_m)


def _sees_a_pole(camera: Camera, pose: CameraPose) -> bool:
    """Whether the picture holds the point straight below or above, around which it sees every azimuth."""
    down = -pose.enu_from_camera[2]
    lens = _lens(camera)
    return bool(in_picture(*down, lens) or in_picture(*-down, lens))


def _azimuths(rays: FloatArray, forward: FloatArray) -> tuple[float, float]:
    """First azimuth and width, radians clockwise from north, that the border's rays (N, 3) span around the forward axis (3,)."""
    middle = math.atan2(forward[0], forward[1])
    offsets = np.arctan2(rays[:, 0], rays[:, 1]) - middle
    offsets = (offsets + np.pi) % (2.0 * np.pi) - np.pi
    return middle + float(offsets.min()), float(offsets.max() - offsets.min())


def _window(terrain: Terrain, position: FloatArray, far: float) -> tuple[IntArray, tuple[int, int]]:
    """First row and column (2,) and shape of the part of the grid within far (cells) of the camera."""
    middle = position[1::-1]
    first = np.clip(np.floor(middle - far), 0, terrain.shape).astype(np.int64)
    last = np.clip(np.floor(middle + far) + 1, 0, terrain.shape).astype(np.int64)
    return first, (int(last[0] - first[0]), int(last[1] - first[1]))
