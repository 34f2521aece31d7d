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

from pipeline.fusion.selection_kernels import select
from pipeline.fusion.tiles import TILE_BITS
from pipeline.fusion.visibility_kernels import frustum, sweep
from pipeline.geo.camera import Camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, FloatArray

#: Distance of neighbouring azimuths at the far end, cells.
_AZIMUTH_SPACING = 0.8
_FEWEST_AZIMUTHS = 64
#: Straight pieces per side of the outline of a picture whose lens bends straight lines.
_PIECES_PER_SIDE = 16

CellArray = NDArray[np.int32]


def visible_cells(
    terrain: Terrain,
    camera: Camera,
    pose: CameraPose,
    max_distance_m: float,
    excluded_boxes_px: FloatArray,
    object_height_m: float = 0.0,
) -> tuple[CellArray, CellArray, FloatArray]:
    """Rows (N,), columns (N,) and distances (N,) in metres of the seen cells, each once, in a fixed order.

    A cell counts up to max_distance_m, measured to its centre. Cells whose centre projects into one of the
    boxes (M, 4) x0, y0, x1, y1 are left out: they lie behind what was detected. So are those where an object
    of object_height_m, standing or lying, would be cut by the picture's border. The camera may stand outside
    the terrain.
    """
    cells, distances = Visibility(terrain).cells(
        camera, pose, max_distance_m, excluded_boxes_px, object_height_m
    )
    return cells[0], cells[1], distances


class Visibility:
    """What cameras see on one terrain. Keeps scratch memory, and the last sweep: detectors share frames."""

    def __init__(self, terrain: Terrain, owned: NDArray[np.bool_] | None = None) -> None:
        """owned: (tile rows, tile columns); a camera that sees none of these tiles need not be swept for."""
        self._terrain, self._owned = terrain, owned
        self._stamps = np.empty(0, dtype=np.uint8)
        self._seen, self._cells = np.empty(1, dtype=np.int32), np.empty((2, 0), dtype=np.int32)
        self._distances = np.empty(0)
        self._last: tuple[object, ...] = ()
        self._window, self._found = (0, 0, 0), 0

    def cells(
        self,
        camera: Camera,
        pose: CameraPose,
        max_distance_m: float,
        excluded_boxes_px: FloatArray,
        object_height_m: float = 0.0,
    ) -> tuple[CellArray, FloatArray]:
        """Rows and columns (2, N) and distances (N,), see visible_cells; views, good until the next call."""
        terrain, camera = self._terrain, camera.zoomed(pose.focal_scale)
        last = camera, pose.position_enu.tobytes(), pose.enu_from_camera.tobytes(), max_distance_m
        if last != self._last:
            self._found = self._sweep(camera, pose, max_distance_m)
            self._last = last
        kept = select(
            terrain.heights_m,
            _position(terrain, pose),
            terrain.cell_m,
            pose.enu_from_camera.T * (terrain.cell_m, terrain.cell_m, 1.0),
            _lens(camera),
            (float(camera.width), float(camera.height)),
            np.ascontiguousarray(excluded_boxes_px, dtype=np.float64).reshape(-1, 4),
            float(object_height_m),
            max_distance_m,
            self._window,
            self._seen[: self._found],
            self._cells,
            self._distances,
        )
        return self._cells[:, :kept], self._distances[:kept]

    def _sweep(self, camera: Camera, pose: CameraPose, max_distance_m: float) -> int:
        """Fill in the cells seen; how many they are."""
        terrain = self._terrain
        position = _position(terrain, pose)
        outline = _outline(camera) @ pose.enu_from_camera.T
        first, width, reach = frustum(outline)
        lowest, highest = terrain.height_range(_window(terrain, position, max_distance_m / terrain.cell_m))
        if lowest > highest:
            return 0
        far_m = max_distance_m if math.isinf(reach) else min(reach * (position[2] - lowest), max_distance_m)
        far = max(far_m, 0.0) / terrain.cell_m
        row, column, rows, columns = _window(terrain, position, far + 2.0)
        if not self._owns_any((row, column, rows, columns)):
            return 0
        self._window = row, column, (columns - 1).bit_length()
        size = rows << self._window[2]
        self._reserve(size)
        count = max(math.ceil(width * far / _AZIMUTH_SPACING), _FEWEST_AZIMUTHS)
        return int(
            sweep(
                terrain.heights_m,
                position,
                outline / (terrain.cell_m, terrain.cell_m, 1.0),
                (first, width, count),
                far,
                lowest,
                highest,
                self._window,
                self._stamps[:size],
                self._seen,
            )
        )

    def _owns_any(self, window: tuple[int, int, int, int]) -> bool:
        row, column, rows, columns = window
        if self._owned is None or not rows or not columns:
            return rows > 0 and columns > 0
        last_row, last_column = (row + rows - 1) >> TILE_BITS, (column + columns - 1) >> TILE_BITS
        return bool(self._owned[row >> TILE_BITS : last_row + 1, column >> TILE_BITS : last_column + 1].any())

    def _reserve(self, size: int) -> None:
        if size > self._stamps.size:
            self._stamps = np.empty(size, dtype=np.uint8)
            self._seen, self._cells = np.empty(size + 1, dtype=np.int32), np.empty((2, size), dtype=np.int32)
            self._distances = np.empty(size)


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
    """The kernels' lens (12,)."""
    lens = np.zeros(12)
    lens[:4] = camera.fx, camera.fy, camera.cx, camera.cy
    lens[4 : 4 + len(camera.distortion)] = camera.distortion
    return lens


def _position(terrain: Terrain, pose: CameraPose) -> tuple[float, float, float]:
    """The camera in cells from the centre of the terrain's first cell, and its height in metres."""
    east, north, up = pose.position_enu.tolist()
    return (
        (east - terrain.east_m) / terrain.cell_m - 0.5,
        (north - terrain.north_m) / terrain.cell_m - 0.5,
        up,
    )


def _window(terrain: Terrain, position: tuple[float, float, float], far: float) -> tuple[int, int, int, int]:
    """First row, first column, rows and columns of the part of the grid within far (cells) of the camera."""
    (rows, columns), (x, y, _) = terrain.shape, position
    row, column = _within(math.floor(y - far + 0.5), rows), _within(math.floor(x - far + 0.5), columns)
    last_row, last_column = (
        _within(math.floor(y + far + 1.5), rows),
        _within(math.floor(x + far + 1.5), columns),
    )
    return row, column, last_row - row, last_column - column


def _within(cell: int, cells: int) -> int:
    return min(max(cell, 0), cells)
