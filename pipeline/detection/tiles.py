"""A picture in tiles: where they lie, and one box for a person whom a seam cuts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipeline.detection.nms import area, iou
from pipeline.messages import FloatArray
from pipeline.sensor.setup import Tiling

IntArray = NDArray[np.int64]
#: a box that ends within this share of its own side of a seam is taken for cut by it: the network cannot know
#: what lies beyond. Chosen on scenes that no figure is of: .1 to .5 differ by 0.01 of AP
CUT_SHARE = 0.25
#: IoU from which two whole boxes of two tiles are one person
_SAME = 0.5
#: of a cut box so much lies in another one of the same person
_INSIDE = 0.6
#: a box this much less sure than another one does not widen it
_LESS_SURE = 0.5
#: of so many boxes of a class the surest of each tile are looked at: more are noise, and cost time
MOST_IN_A_TILE = 300


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


def whole_up_to(width: int, height: int, tiling: Tiling) -> tuple[int, int]:
    """How wide and how high somebody can be, in pixels, and still be seen whole by some tile wherever he is."""
    sides = []
    for length, tile in ((width, tiling.width), (height, tiling.height)):
        starts = _starts(length, tile, tiling.overlap)
        overlap = min((a + tile - b for a, b in pairwise(starts)), default=tile)
        # at a seam a share of the side is not trusted, in each of the two tiles
        sides.append(math.floor(overlap / (1.0 + 2.0 * CUT_SHARE)) if len(starts) > 1 else min(length, tile))
    return sides[0], sides[1]


@dataclass(frozen=True, eq=False)
class _Boxes:
    """Boxes (N, 4) xyxy of one class with their scores (N,), the windows (N,) they are from, and which are cut."""

    xyxy: FloatArray
    scores: FloatArray
    window: IntArray
    cut: NDArray[np.bool_]


def merged(
    boxes: FloatArray,
    scores: FloatArray,
    window: IntArray,
    windows: IntArray,
    size: tuple[int, int],
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Boxes of one class from all windows, each person once: boxes, scores, and the indices that they are of.

    boxes (N, 4) xyxy in pixels of the picture, after suppression within each window. window (N,): where each
    is from. A box at a seam is the neighbour's to see, where the neighbour sees that place whole: it goes, even
    if the neighbour finds nothing there. Where none does, because people are larger than the overlap, two
    halves from neighbouring windows become the box around both. Of whole boxes that are one person the surest
    stays.
    """
    if not len(boxes):
        return boxes, scores, np.zeros(0, np.int64)
    gaps, whole = _gaps(boxes, windows, size), _is_whole_picture(windows, size)
    own = np.arange(len(boxes)), window
    cut = ~gaps[own]
    gaps[own] = False
    # a pass over the whole picture sees every place, but perhaps nobody who is small
    gaps[:, whole] = False
    left = np.flatnonzero(~(cut & gaps.any(axis=1)))
    kept, around, worth = _each_once(_Boxes(boxes[left], scores[left], window[left], cut[left]))
    order = np.lexsort((kept, -worth))
    return around[order], worth[order], left[kept[order]]


def _is_whole_picture(windows: IntArray, size: tuple[int, int]) -> NDArray[np.bool_]:
    if len(windows) == 1:
        return np.zeros(1, bool)
    return np.asarray((windows == np.array([0, 0, *size])).all(axis=1))


def _gaps(boxes: FloatArray, windows: IntArray, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Which boxes (N, W) lie in each window, and not at an edge of it that is no edge of the picture."""
    sides = np.tile(boxes[:, 2:] - boxes[:, :2], 2)
    low, high = boxes[:, None, :2] - windows[None, :, :2], windows[None, :, 2:] - boxes[:, None, 2:]
    room = np.concatenate([low, high], axis=2) >= CUT_SHARE * sides[:, None]
    at_the_end = np.concatenate([windows[:, :2] <= 0, windows[:, 2:] >= np.array(size)], axis=1)
    return np.asarray((room | at_the_end[None]).all(axis=2))


def _each_once(found: _Boxes) -> tuple[IntArray, FloatArray, FloatArray]:
    """Indices of the boxes that stay; the boxes, as wide as their halves; the scores of the surest looks."""
    kept: list[int] = []
    around, worth = found.xyxy.copy(), found.scores.copy()
    for index in np.lexsort(
        (-found.scores, found.cut)
    ).tolist():  # whole boxes first, each kind the surest first
        others = np.array(kept, np.int64)
        same = others[_is_same(found, index, others, around)]
        if not len(same):
            kept.append(index)
            continue
        other = int(same[np.argmax(worth[same])])
        if found.cut[other] and found.scores[index] >= _LESS_SURE * found.scores[other]:
            around[other, :2] = np.minimum(around[other, :2], found.xyxy[index, :2])
            around[other, 2:] = np.maximum(around[other, 2:], found.xyxy[index, 2:])
        worth[other] = max(worth[other], found.scores[index])
    chosen = np.array(kept, np.int64)
    return chosen, around[chosen], worth[chosen]


def _is_same(found: _Boxes, index: int, others: IntArray, around: FloatArray) -> NDArray[np.bool_]:
    """Which of the others are the same person as a box, seen from another window."""
    box, theirs = found.xyxy[index], around[others]
    elsewhere = found.window[others] != found.window[index]
    if not found.cut[index]:
        return np.asarray(elsewhere & (iou(box, theirs) > _SAME))
    low, high = np.maximum(theirs[:, :2], box[:2]), np.minimum(theirs[:, 2:], box[2:])
    shared = np.clip(high - low, 0.0, None).prod(axis=1)
    least = np.minimum(area(theirs), area(box[None]))
    return np.asarray(elsewhere & (shared >= _INSIDE * np.maximum(least, 1e-9)))
