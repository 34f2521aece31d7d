"""Which cells a look raises, and which it must not lower, when it is known only roughly where it points.

The paper's rule raises the cell of the significant point and lowers all others in view. With a position known to
half a metre over cells of half a metre, the cell where the person stands is then lowered by every frame whose box
falls beside it. Here a look has a width: for the person of a box at z with covariance S,

    m^2(c) = d^T S^-1 d, d from z to the nearest point of cell c
    weight(c) = min(1, exp(1 - m^2(c) / 2))

The weight is the normal density over its mean (geometric) among true looks: E[m^2 / 2] = 1 in two dimensions. So a
cell that is as near to z as the places of true looks typically are gets the paper's whole update, and no cell
gets more. With S = 0 the weight is 1 in the cell of z and 0 elsewhere: the paper's rule.

Of a frame, each cell gets the log of the likelihood ratio (the update of the PHD filter on a grid: B.-N. Vo,
W.-K. Ma, The Gaussian mixture probability hypothesis density filter, 2006, with one object at most per cell)

    raise(c) e^R + (1 - raise(c)) (shield(c) + (1 - shield(c)) e^-N)

with e^R, e^-N the odds of the paper's positive and negative update; of several boxes the one that says most. raise
is the weight by the noise of this look alone, shield that by all its errors: see ``look_covariance``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from pipeline.geo.terrain import Terrain
from pipeline.messages import FloatArray

#: weights below it are taken for 0
_LEAST_WEIGHT = 1e-3
#: standard deviations at which the weight is _LEAST_WEIGHT
_REACH = float(np.sqrt(2.0 * (1.0 - np.log(_LEAST_WEIGHT))))
#: cells from the middle of a footprint to its edge at most: beyond, a look says next to nothing about where
_MOST_CELLS = 128


@dataclass(frozen=True, eq=False)
class Footprints:
    """Of the N looks of a frame at one class.

    windows: int64 (N, 4), first row, first column, rows and columns. starts: int64 (N + 1,), where the cells of a
    window begin in raised and shielded. raised, shielded: float64 (K,), weights in 0..1, row by row; 0 where there
    is no voxel. odds: float64 (N,), of the looks' positive updates, p / (1 - p).
    """

    windows: NDArray[np.int64]
    starts: NDArray[np.int64]
    raised: FloatArray
    shielded: FloatArray
    odds: FloatArray


NO_FOOTPRINTS = Footprints(
    np.zeros((0, 4), dtype=np.int64), np.zeros(1, dtype=np.int64), np.zeros(0), np.zeros(0), np.zeros(0)
)


def footprints(
    terrain: Terrain, points_enu: FloatArray, noise_m2: FloatArray, total_m2: FloatArray, p: FloatArray
) -> Footprints:
    """points_enu: (N, >=2), where the looks meet the ground, on the terrain. noise_m2, total_m2: (N, 2, 2).

    p: (N,), of the looks' positive updates, 0.5..1.
    """
    windows = _windows(points_enu, total_m2, terrain)
    starts = np.concatenate([[0], np.cumsum(windows[:, 2] * windows[:, 3])]).astype(np.int64)
    raised, shielded = np.zeros(starts[-1]), np.zeros(starts[-1])
    grid = terrain.east_m, terrain.north_m, terrain.cell_m
    for covariance, weights in ((noise_m2, raised), (total_m2, shielded)):
        _weigh(terrain.heights_m, grid, points_enu, covariance, windows, starts, weights)
    return Footprints(windows, starts, raised, shielded, p / (1.0 - p))


def _windows(points: FloatArray, covariance: FloatArray, terrain: Terrain) -> NDArray[np.int64]:
    sd_m = np.sqrt(np.stack([covariance[:, 1, 1], covariance[:, 0, 0]], axis=1))
    at = (points[:, [1, 0]] - (terrain.north_m, terrain.east_m)) / terrain.cell_m
    most = np.array(terrain.shape)
    reach = np.minimum(_REACH * sd_m / terrain.cell_m, _MOST_CELLS)
    first = np.clip(np.floor(at - reach), 0, most - 1).astype(np.int64)
    last = np.clip(np.floor(at + reach), 0, most - 1).astype(np.int64)
    return np.concatenate([first, last - first + 1], axis=1)


@numba.njit(cache=True, error_model="numpy")
def _weigh(heights, grid, points, covariances, windows, starts, weights):  # type: ignore[no-untyped-def]
    east_m, north_m, cell_m = grid
    for i in range(points.shape[0]):
        row, column, rows, columns = windows[i]
        x, y = (points[i, 0] - east_m) / cell_m, (points[i, 1] - north_m) / cell_m
        a, b, c = covariances[i, 0, 0], covariances[i, 0, 1], covariances[i, 1, 1]
        determinant = a * c - b * b
        k = starts[i]
        for r in range(row, row + rows):
            north = (min(max(y, r), r + 1.0) - y) * cell_m
            for q in range(column, column + columns):
                east = (min(max(x, q), q + 1.0) - x) * cell_m
                inside = int(y) == r and int(x) == q
                weight = 1.0 if inside else 0.0
                if not inside and determinant > 0.0:
                    squared = (c * east * east - 2.0 * b * east * north + a * north * north) / determinant
                    weight = min(1.0, np.exp(1.0 - 0.5 * squared))
                if weight >= _LEAST_WEIGHT and np.isfinite(heights[r, q]):
                    weights[k] = weight
                k += 1
