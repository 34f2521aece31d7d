"""Lines of equal height over the ground that is shown."""

from __future__ import annotations

from typing import Any

import contourpy
import numpy as np

from pipeline.messages import FloatArray
from pipeline.view.ground import Ground

#: lines of different height, at most
_MOST_LINES = 20
#: every so many-th one is drawn stronger, with its height
_INDEX = 5
#: cells on the longer side of what lines are drawn over: a tree must not be a knot of lines
_SIDE = 150
#: shorter ones say nothing, points
_LEAST_POINTS = 8
#: less difference than this is no relief, metres
_FLAT_M = 1.0


def contours(ground: Ground) -> list[dict[str, Any]]:
    """Each ``{height_m, index, lines}``; lines: points (east, north), metres; index: whether it is drawn stronger.

    Of means over squares of at most 1/150 of the longer side; the surface model's own heights, trees and roofs too.
    Heights are multiples of 1, 2 or 5 times a power of ten.
    """
    side = max(1, -(-max(ground.heights_m.shape) // _SIDE))
    heights = _means(ground.heights_m.astype(np.float64), side)
    if min(heights.shape) < 2 or not np.isfinite(heights).any():
        return []
    low, high = float(np.nanmin(heights)), float(np.nanmax(heights))
    if high - low < _FLAT_M:
        return []
    step, cell_m = _step(high - low), ground.cell_m * side
    east = ground.east_m + (np.arange(heights.shape[1]) + 0.5) * cell_m
    north = ground.north_m + (np.arange(heights.shape[0]) + 0.5) * cell_m
    lines = contourpy.contour_generator(east, north, np.ma.masked_invalid(heights))
    found = []
    for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1):
        separate = [np.asarray(line, np.float64) for line in lines.lines(k * step)]
        of_height = [line.round(1).tolist() for line in separate if len(line) >= _LEAST_POINTS]
        if of_height:
            found.append({"height_m": round(k * step, 3), "index": k % _INDEX == 0, "lines": of_height})
    return found


def _means(heights: FloatArray, side: int) -> FloatArray:
    """Of squares; NaN where none of it is known."""
    rows, columns = (-(-n // side) * side for n in heights.shape)
    wide = np.full((rows, columns), np.nan)
    wide[: heights.shape[0], : heights.shape[1]] = heights
    blocks = wide.reshape(rows // side, side, columns // side, side)
    known = np.isfinite(blocks)
    count = known.sum(axis=(1, 3))
    total = np.where(known, blocks, 0.0).sum(axis=(1, 3))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _step(range_m: float) -> float:
    """Metres from one line to the next."""
    for power in range(-1, 5):
        for factor in (1.0, 2.0, 5.0):
            step = factor * 10.0**power
            if range_m / step <= _MOST_LINES:
                return step
    return 1e5
