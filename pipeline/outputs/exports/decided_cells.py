"""The map as reviewers have left it: what they decided of a place, its cells carry too."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rasterio
from rasterio.warp import transform

from pipeline.messages import FloatArray


@dataclass(frozen=True)
class Shift:
    """class_name: of the layer. latitude_deg, longitude_deg: of a place. semi_major_m, semi_minor_m: of its ellipse;
    orientation_deg: of the longer axis, from north by east. log_odds: what the decisions add there.
    """

    class_name: str
    latitude_deg: float
    longitude_deg: float
    semi_major_m: float
    semi_minor_m: float
    orientation_deg: float
    log_odds: float


def decided_cells(source: rasterio.DatasetReader, shifts: Sequence[Shift]) -> tuple[FloatArray, FloatArray]:
    """Bands ``probability`` and ``log_odds`` of a ``saliency.tif`` after the decisions, float32 (rows, columns) each.

    Cells whose centre is in a place's ellipse, or within a cell of its middle, are shifted; the bands are shifted each
    by itself, since the published probability is not the filter's state. Cells that nobody looked at stay NaN.
    """
    names = list(source.descriptions)
    probability, state = (source.read(names.index(name) + 1) for name in ("probability", "log_odds"))
    for shift in shifts:
        rows, columns = _reached(source, shift)
        p = np.clip(probability[rows, columns].astype(np.float64), 1e-9, 1.0 - 1e-9)
        odds = np.log(p / (1.0 - p)) + shift.log_odds
        probability[rows, columns] = 1.0 / (1.0 + np.exp(-odds))
        state[rows, columns] += shift.log_odds
    return probability, state


def _reached(source: rasterio.DatasetReader, shift: Shift) -> tuple[FloatArray, FloatArray]:
    """Rows and columns of the cells of a place."""
    (east,), (north,) = transform("EPSG:4326", source.crs, [shift.longitude_deg], [shift.latitude_deg])
    cell_m = source.transform.a
    column, row = ~source.transform @ (east, north)
    reach = math.ceil(max(shift.semi_major_m, cell_m) / cell_m) + 1
    rows, columns = np.indices((2 * reach + 1, 2 * reach + 1)) + np.array(
        [[[int(row) - reach]], [[int(column) - reach]]]
    )
    to_east, to_north = (columns + 0.5 - column) * cell_m, (row - rows - 0.5) * cell_m
    turn = math.radians(shift.orientation_deg)
    along = to_north * math.cos(turn) + to_east * math.sin(turn)
    across = to_east * math.cos(turn) - to_north * math.sin(turn)
    major, minor = max(shift.semi_major_m, cell_m), max(shift.semi_minor_m, cell_m)
    inside = (along / major) ** 2 + (across / minor) ** 2 <= 1.0
    inside &= (rows >= 0) & (rows < source.height) & (columns >= 0) & (columns < source.width)
    return rows[inside], columns[inside]
