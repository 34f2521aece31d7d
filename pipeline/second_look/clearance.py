"""How near a way comes to the surface: a check that shares nothing with how the way was made."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pipeline.geo.terrain import Terrain
from pipeline.messages import FloatArray

#: the way is looked at in steps of this share of a cell
_STEP = 0.5


@dataclass(frozen=True)
class Clearance:
    """least_m: above the highest of the cells about each point of the way, where any is known; inf: none is.

    unknown_m: length of the way over ground of which no cell is known.
    """

    least_m: float
    unknown_m: float


def clearance_of(points_enu: FloatArray, terrain: Terrain) -> Clearance:
    """Of the straight legs between points (N >= 1, 3), metres."""
    least_m, unknown_m = math.inf, 0.0
    for start, end in pairwise([points_enu[0], *points_enu]):
        length_m = float(np.linalg.norm((end - start)[:2]))
        steps = max(math.ceil(length_m / (_STEP * terrain.cell_m)), 1)
        way = start + (end - start) * np.linspace(0.0, 1.0, steps + 1)[:, None]
        surface = _highest_about(way, terrain)
        known = np.isfinite(surface)
        if known.any():
            least_m = min(least_m, float((way[:, 2] - surface)[known].min()))
        unknown_m += length_m * float((~known).mean())
    return Clearance(least_m, unknown_m)


def _highest_about(points_enu: FloatArray, terrain: Terrain) -> FloatArray:
    """The highest known of the nine cells about each point (N,); NaN where none is known."""
    column = np.floor((points_enu[:, 0] - terrain.east_m) / terrain.cell_m).astype(np.int64)
    row = np.floor((points_enu[:, 1] - terrain.north_m) / terrain.cell_m).astype(np.int64)
    highest = np.full(len(points_enu), -np.inf)
    rows, columns = terrain.shape
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            r, c = row + down, column + right
            inside = (r >= 0) & (r < rows) & (c >= 0) & (c < columns)
            heights = np.where(
                inside, terrain.heights_m[np.clip(r, 0, rows - 1), np.clip(c, 0, columns - 1)], np.nan
            )
            highest = np.fmax(highest, heights)
    return np.where(np.isfinite(highest), highest, np.nan)
