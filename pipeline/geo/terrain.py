"""The ground as a regular grid of heights in the map frame (2.5-D), read from a surface model (DSM)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.height_blocks import BLOCK, STRIP, block_range, on_disk
from pipeline.geo.surface_model import SurfaceModel, bounds_m, center_wgs84, mosaic
from pipeline.messages import FloatArray

_MOST_CELLS, _MOST_CELLS_ON_DISK = 400_000_000, 100_000_000_000


@dataclass(frozen=True, eq=False)
class Terrain:
    """heights_m: float32 (rows, columns), NaN where unknown; row 0 is the *south* edge, column 0 the west.

    Cell (r, c) covers east_m + c * cell_m .. + cell_m, north_m + r * cell_m .. + cell_m; its height is that
    of its centre. The array may be a file on disk, of which only what is looked at comes into memory.
    block_range_m: float32 (2, rows, columns of blocks of BLOCK cells), least and greatest height of each
    block; worked out when first needed if absent. stood_in: bool (rows, columns), where something else stands for a
    surface model that knows no height, and stood_in_sd_m, how far the ground may be from it; none if absent. cover:
    float32 (rows, columns), of people there the share that no camera above can see, 0..1; none if absent.
    """

    frame: LocalFrame
    east_m: float
    north_m: float
    cell_m: float
    heights_m: NDArray[np.float32]
    block_range_m: NDArray[np.float32] | None = None
    stood_in: NDArray[np.bool_] | None = None
    stood_in_sd_m: float = 0.0
    cover: NDArray[np.float32] | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows, columns."""
        return self.heights_m.shape[0], self.heights_m.shape[1]

    def cells(self, points_enu: FloatArray) -> NDArray[np.int64]:
        """Row and column (N, 2) of points (N, >=2); -1, -1 outside."""
        column = np.floor((points_enu[:, 0] - self.east_m) / self.cell_m)
        row = np.floor((points_enu[:, 1] - self.north_m) / self.cell_m)
        inside = (row >= 0) & (row < self.shape[0]) & (column >= 0) & (column < self.shape[1])
        return np.where(inside[:, None], np.stack([row, column], axis=1), -1).astype(np.int64)

    def cell(self, east_m: float, north_m: float) -> tuple[int, int]:
        """Row and column of a position; -1, -1 outside."""
        row, column = (north_m - self.north_m) / self.cell_m, (east_m - self.east_m) / self.cell_m
        if not (0.0 <= row < self.shape[0] and 0.0 <= column < self.shape[1]):
            return -1, -1
        return int(row), int(column)

    def extra_sd_m(self, row: int, column: int) -> float:
        """Standard deviation of a cell's height beside that of the surface model, metres: of what stands in for it."""
        if self.stood_in is None or row < 0 or not self.stood_in[row, column]:
            return 0.0
        return self.stood_in_sd_m

    def centers(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> FloatArray:
        """Centres (N, 3) of cells on the surface."""
        return np.stack(
            [
                self.east_m + (columns + 0.5) * self.cell_m,
                self.north_m + (rows + 0.5) * self.cell_m,
                self.heights_m[rows, columns].astype(np.float64),
            ],
            axis=1,
        )

    def height(self, east_m: float, north_m: float) -> float:
        """Bilinear surface height at a position; NaN outside or where unknown."""
        return float(
            _bilinear(
                self.heights_m,
                (east_m - self.east_m) / self.cell_m - 0.5,
                (north_m - self.north_m) / self.cell_m - 0.5,
            )
        )

    def height_range(self, window: tuple[int, int, int, int]) -> tuple[float, float]:
        """Bounds of the heights in a window (first row, first column, rows, columns); (inf, -inf): none."""
        row, column, rows, columns = window
        if not rows or not columns:
            return math.inf, -math.inf
        blocks = self._block_range[
            :,
            row // BLOCK : (row + rows - 1) // BLOCK + 1,
            column // BLOCK : (column + columns - 1) // BLOCK + 1,
        ]
        return float(blocks[0].min()), float(blocks[1].max())

    @cached_property
    def _block_range(self) -> NDArray[np.float32]:
        if self.block_range_m is not None:
            return self.block_range_m
        return block_range(self.heights_m)

    def intersect(
        self, origin_enu: FloatArray, direction_enu: FloatArray, max_distance_m: float
    ) -> FloatArray | None:
        """First point (3,) where a ray meets the bilinear surface, to 1 cm, or None."""
        t = _march(
            self.heights_m,
            self.east_m,
            self.north_m,
            self.cell_m,
            np.asarray(origin_enu, np.float64),
            np.asarray(direction_enu, np.float64),
            max_distance_m,
        )
        return None if t < 0 else np.asarray(origin_enu + t * direction_enu, dtype=np.float64)


def frame_of(path: Path) -> LocalFrame:
    """The map frame with its origin at the middle of a surface model."""
    return LocalFrame(*center_wgs84(path))


def load_terrain(
    models: Sequence[SurfaceModel],
    cell_m: float,
    frame: LocalFrame,
    window_m: tuple[float, float, float, float] | None = None,
    folder: Path | None = None,
    *,
    beyond: bool = False,
) -> Terrain:
    """Surface models in the cells of the map frame. Raises InputError if they know no height there.

    models: where they overlap, the first that knows a height counts. window_m: west, south, east and north of
    the part that is wanted; all of the models if absent. beyond: the terrain is as large as the window, NaN outside of
    the models. folder: where the heights of a terrain larger than
    memory are put, in a file without a name that is gone with the process; in memory if absent.
    """
    bounds = [window_m] if beyond and window_m is not None else [bounds_m(m.path, frame) for m in models]
    west_m, south_m, shape = _grid(bounds, cell_m, window_m)
    where = ", ".join(str(m.path) for m in models)
    if min(shape) <= 0:
        raise InputError(where, "a surface model far from the flights", "one under them")
    most = _MOST_CELLS if folder is None else _MOST_CELLS_ON_DISK
    if shape[0] * shape[1] > most:
        found = f"{shape[0]} x {shape[1]} cells of {cell_m} m"
        raise InputError(where, found, f"at most {most:.0e} cells: a larger cell_size")

    def strip(first: int, last: int) -> NDArray[np.float32]:
        north_up = mosaic(models, frame, cell_m, west_m, south_m + last * cell_m, (last - first, shape[1]))
        return np.ascontiguousarray(north_up[::-1])

    ranges = None
    if folder is None:
        heights_m = strip(0, shape[0])
    else:
        rows = range(0, shape[0], STRIP)
        strips = (strip(row, min(row + STRIP, shape[0])) for row in rows)
        heights_m, ranges = on_disk(strips, shape, folder)
    known = np.isfinite(heights_m).any() if ranges is None else (ranges[0] <= ranges[1]).any()
    if not known:
        raise InputError(where, "no height at all", "a surface model with heights")
    return Terrain(frame, west_m, south_m, cell_m, heights_m, ranges)


def _grid(
    bounds: Sequence[tuple[float, float, float, float]],
    cell_m: float,
    window_m: tuple[float, float, float, float] | None,
) -> tuple[float, float, tuple[int, int]]:
    """West and south edge, metres, and rows and columns of the terrain that holds the surface models."""
    west, south = (min(b[k] for b in bounds) for k in (0, 1))
    east, north = (max(b[k] for b in bounds) for k in (2, 3))
    if window_m is not None:
        west, south = max(west, window_m[0]), max(south, window_m[1])
        east, north = min(east, window_m[2]), min(north, window_m[3])
    west, south = (math.floor(edge / cell_m) * cell_m for edge in (west, south))
    return west, south, (math.ceil((north - south) / cell_m), math.ceil((east - west) / cell_m))


@numba.njit(cache=True)
def _bilinear(heights, x, y):  # type: ignore[no-untyped-def]
    rows, columns = heights.shape
    if not (-0.5 <= x <= columns - 0.5 and -0.5 <= y <= rows - 0.5):
        return np.nan
    x, y = min(max(x, 0.0), columns - 1.0), min(max(y, 0.0), rows - 1.0)
    c, r = min(int(x), max(columns - 2, 0)), min(int(y), max(rows - 2, 0))
    c1, r1 = min(c + 1, columns - 1), min(r + 1, rows - 1)
    fx, fy = x - c, y - r
    low = heights[r, c] * (1 - fx) + heights[r, c1] * fx
    high = heights[r1, c] * (1 - fx) + heights[r1, c1] * fx
    return low * (1 - fy) + high * fy


@numba.njit(cache=True)
def _march(heights, east, north, cell, origin, direction, reach):  # type: ignore[no-untyped-def]
    step = 0.25 * cell
    before, t = 0.0, 0.0
    while t <= reach:
        x, y = (
            (origin[0] + t * direction[0] - east) / cell - 0.5,
            (origin[1] + t * direction[1] - north) / cell - 0.5,
        )
        ground = _bilinear(heights, x, y)
        if origin[2] + t * direction[2] <= ground:
            low, high = before, t
            while high - low > 0.005:
                middle = 0.5 * (low + high)
                x = (origin[0] + middle * direction[0] - east) / cell - 0.5
                y = (origin[1] + middle * direction[1] - north) / cell - 0.5
                if origin[2] + middle * direction[2] <= _bilinear(heights, x, y):
                    high = middle
                else:
                    low = middle
            return high
        before = t
        t += step
    return -1.0
