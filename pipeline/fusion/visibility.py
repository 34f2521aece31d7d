"""Which surface cells a camera sees: a horizon sweep in azimuth over the terrain.

A cell is seen if a part of the surface over it lies in the picture and no surface hides it. The surface is
the terrain's bilinear one, the same that detections are intersected with. Cells of unknown height neither
hide nor are seen.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.fusion.visibility_kernels import observe, sweep
from pipeline.geo.camera import Camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, FloatArray

#: Distance of neighbouring azimuths at the far end, cells.
_AZIMUTH_SPACING = 0.7
_FEWEST_AZIMUTHS = 64
#: Straight pieces per side of the outline of a picture whose lens bends straight lines.
_PIECES_PER_SIDE = 16

IntArray = NDArray[np.int64]


def visible_cells(
    terrain: Terrain,
    camera: Camera,
    pose: CameraPose,
    max_distance_m: float,
    excluded_boxes_px: FloatArray,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows (N,), columns (N,) and distances (N,) in metres of the seen cells, each once, in a fixed order.

    A cell counts up to max_distance_m, measured to its centre. Cells whose centre projects into one of the
    boxes (M, 4) x0, y0, x1, y1 are left out: they lie behind what was detected. The camera may stand outside
    the terrain.
    """
    cell = np.array([terrain.cell_m, terrain.cell_m, 1.0])
    position = (pose.position_enu - np.array([terrain.east_m, terrain.north_m, 0.0])) / cell
    outline = _outline(camera) @ pose.enu_from_camera.T
    lowest, highest = _height_range(terrain)
    far = _far_m(outline, position[2] - lowest, max_distance_m) / terrain.cell_m
    corner, shape = _window(terrain, position, far)
    stamps = np.zeros(shape, dtype=np.uint8)
    cells = np.empty((2, stamps.size), dtype=np.int64)
    azimuths = _azimuths(outline, far)
    drop = max(position[2] - highest, 0.0)
    found = sweep(terrain.heights_m, position, outline / cell, azimuths, far, drop, stamps, corner, cells)
    distances = np.empty(found)
    boxes = np.ascontiguousarray(excluded_boxes_px, dtype=np.float64).reshape(-1, 4)
    toward_camera = pose.enu_from_camera.T * cell
    kept = observe(
        terrain.heights_m,
        position,
        terrain.cell_m,
        toward_camera,
        _lens(camera),
        boxes,
        max_distance_m,
        cells,
        distances,
    )
    return cells[0, :kept], cells[1, :kept], distances[:kept]


@lru_cache(maxsize=64)
def _outline(camera: Camera) -> FloatArray:
    """Directions (N, 3) in the camera frame around the picture, so close that straight lines join them."""
    pieces = _PIECES_PER_SIDE if camera.distortion.any() else 1
    share = np.arange(pieces) / pieces
    zero, one = np.zeros(pieces), np.ones(pieces)
    x = np.concatenate([share, one, 1.0 - share, zero])
    y = np.concatenate([zero, share, one, 1.0 - share])
    return camera.rays(np.stack([x * camera.width, y * camera.height], axis=1))


@lru_cache(maxsize=64)
def _lens(camera: Camera) -> FloatArray:
    """The kernels' lens (9,)."""
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])


@lru_cache(maxsize=8)
def _height_range(terrain: Terrain) -> tuple[float, float]:
    return float(np.nanmin(terrain.heights_m)), float(np.nanmax(terrain.heights_m))


def _far_m(outline: FloatArray, above_lowest_m: float, max_distance_m: float) -> float:
    """Horizontal distance beyond which the picture is below the lowest cell, or the greatest asked."""
    down = -outline[:, 2]
    if (down <= 0.0).any():
        return max_distance_m
    away_per_metre_down = np.hypot(outline[:, 0], outline[:, 1]) / down
    return min(max(above_lowest_m, 0.0) * float(away_per_metre_down.max()), max_distance_m)


def _azimuths(outline: FloatArray, far: float) -> FloatArray:
    """Azimuths (M,) that cover the picture, radians clockwise from north, for a far end of so many cells.

    outline: (N, 3) directions in the map frame, in order.
    """
    angles = np.arctan2(outline[:, 0], outline[:, 1])
    turns = (np.diff(angles, append=angles[:1]) + np.pi) % (2.0 * np.pi) - np.pi
    if abs(turns.sum()) > np.pi:  # the outline runs once around a pole, so the picture holds every azimuth
        first, width = 0.0, 2.0 * np.pi
    else:
        offsets = np.cumsum(turns)
        first, width = angles[0] + offsets.min(), offsets.max() - offsets.min()
    count = max(math.ceil(width * far / _AZIMUTH_SPACING), _FEWEST_AZIMUTHS)
    return np.asarray(first + width / count * np.arange(count + 1.0), dtype=np.float64)


def _window(terrain: Terrain, position: FloatArray, far: float) -> tuple[IntArray, tuple[int, int]]:
    """First row and column (2,) and shape of the part of the grid within far (cells) of the camera."""
    middle = position[1::-1]
    first = np.clip(np.floor(middle - far), 0, terrain.shape).astype(np.int64)
    last = np.clip(np.floor(middle + far) + 1, 0, terrain.shape).astype(np.int64)
    return first, (int(last[0] - first[0]), int(last[1] - first[1]))
