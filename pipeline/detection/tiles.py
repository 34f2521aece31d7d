"""A picture in tiles: where they lie, and one box for a person whom a seam cuts."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.detection.nms import area
from pipeline.messages import FloatArray
from pipeline.sensor.setup import Tiling

IntArray = NDArray[np.int64]
#: a box this near to a seam is cut by it, pixels of the picture
CUT_PX = 3.0
#: of two boxes of one person from two tiles, so much of the smaller one lies in the other
_INSIDE = 0.6


def windows_of(width: int, height: int, tiling: Tiling) -> IntArray:
    """Tiles (N, 4) xyxy that cover a picture, spread evenly, and the whole picture last if it is wanted."""
    columns = _starts(width, tiling.width, tiling.overlap)
    rows = _starts(height, tiling.height, tiling.overlap)
    wide, high = min(width, tiling.width), min(height, tiling.height)
    tiles = [(x, y, x + wide, y + high) for y in rows for x in columns]
    if tiling.whole and len(tiles) > 1:
        tiles.append((0, 0, width, height))
    return np.array(tiles, np.int64)


def _starts(length: int, tile: int, overlap: float) -> list[int]:
    if tile >= length:
        return [0]
    step = max(1.0, tile * (1.0 - overlap))
    count = 1 + math.ceil((length - tile) / step - 1e-9)
    return [round(start) for start in np.linspace(0, length - tile, count)]


def merged(
    boxes: FloatArray,
    scores: FloatArray,
    window: IntArray,
    windows: IntArray,
    size: tuple[int, int],
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Boxes of one class from all windows, each person once: boxes, scores, and the indices that they are of.

    boxes (N, 4) xyxy in pixels of the picture, after suppression within each window. window (N,): where each
    is from. A box that a seam cuts goes if another window has most of it; two halves from neighbouring
    windows that overlap become the box around both.
    """
    if not len(boxes):
        return boxes, scores, np.zeros(0, np.int64)
    cut = _cut(boxes, windows[window], size)
    order = np.lexsort((-scores, cut))  # whole boxes first, each kind by falling score
    kept: list[int] = []
    around = boxes.copy()
    for index in order:
        if not kept:
            kept.append(int(index))
            continue
        others = np.array(kept)
        low = np.maximum(around[others, :2], boxes[index, :2])
        high = np.minimum(around[others, 2:], boxes[index, 2:])
        shared = np.clip(high - low, 0.0, None).prod(axis=1)
        least = np.minimum(area(around[others]), float(area(boxes[index][None])[0]))
        same = (shared >= _INSIDE * np.maximum(least, 1e-9)) & (window[others] != window[index])
        if not same.any():
            kept.append(int(index))
            continue
        other = int(others[np.argmax(np.where(same, shared, -1.0))])
        if cut[index] and cut[other]:
            around[other, :2] = np.minimum(around[other, :2], boxes[index, :2])
            around[other, 2:] = np.maximum(around[other, 2:], boxes[index, 2:])
        scores = _raised(scores, other, float(scores[index]))
    chosen = np.array(sorted(kept, key=lambda k: (-scores[k], k)), np.int64)
    return around[chosen], scores[chosen], chosen


def _raised(scores: FloatArray, at: int, score: float) -> FloatArray:
    """The surer of two looks at one person."""
    if score <= scores[at]:
        return scores
    scores = scores.copy()
    scores[at] = score
    return scores


def _cut(boxes: FloatArray, windows: IntArray, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Which boxes (N,) touch an edge of their window that is no edge of the picture."""
    at_low = (boxes[:, :2] <= windows[:, :2] + CUT_PX) & (windows[:, :2] > 0)
    at_high = (boxes[:, 2:] >= windows[:, 2:] - CUT_PX) & (windows[:, 2:] < np.array(size))
    return np.asarray((at_low | at_high).any(axis=1))
