"""Numba kernel of COCO's assignment of found boxes to true ones."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from pipeline.messages import FloatArray

#: COCO's own bound: a perfect overlap still matches at a threshold of 1
_BELOW_ONE = 1.0 - 1e-10


@numba.njit(cache=True, nogil=True)
def overlap(found: FloatArray, true: FloatArray, crowd: bool) -> float:
    """IoU of two boxes (4,) x, y, width, height; of the found box's area alone in a crowd."""
    width = min(found[0] + found[2], true[0] + true[2]) - max(found[0], true[0])
    height = min(found[1] + found[3], true[1] + true[3]) - max(found[1], true[1])
    if width <= 0.0 or height <= 0.0:
        return 0.0
    shared = width * height
    area = found[2] * found[3]
    return shared / (area if crowd else area + true[2] * true[3] - shared)


@numba.njit(cache=True, nogil=True)
def assign(
    found: FloatArray,
    found_starts: NDArray[np.int64],
    true: FloatArray,
    true_starts: NDArray[np.int64],
    crowd: NDArray[np.bool_],
    ignored: NDArray[np.bool_],
    thresholds: FloatArray,
    partner: NDArray[np.int64],
    iou: FloatArray,
) -> None:
    """Fill partner (T, D), the true box of each found one or -1, and iou (T, D), 0 where there is none.

    found (D, 4), by falling score, and true (N, 4), ignored last, are cut into groups by starts (G + 1,).
    Each found box takes the free true box that it overlaps most, the later one of two alike; an ignored one
    only if no other will do; a crowd is never taken. This is COCOeval.evaluateImg.
    """
    for group in range(len(found_starts) - 1):
        first, last = true_starts[group], true_starts[group + 1]
        if first == last:
            continue
        count = found_starts[group + 1] - found_starts[group]
        overlaps = np.empty((count, last - first))
        for d in range(count):
            for g in range(last - first):
                overlaps[d, g] = overlap(found[found_starts[group] + d], true[first + g], crowd[first + g])
        for t in range(len(thresholds)):
            taken = np.zeros(last - first, np.bool_)
            for d in range(count):
                best, match = min(thresholds[t], _BELOW_ONE), -1
                for g in range(last - first):
                    if taken[g] and not crowd[first + g]:
                        continue
                    if match > -1 and not ignored[first + match] and ignored[first + g]:
                        break
                    if overlaps[d, g] < best:
                        continue
                    best, match = overlaps[d, g], g
                if match > -1:
                    taken[match] = True
                    partner[t, found_starts[group] + d] = first + match
                    iou[t, found_starts[group] + d] = best
