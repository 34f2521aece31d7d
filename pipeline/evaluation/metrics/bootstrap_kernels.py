"""Numba kernel of COCO's average precision with a weight for each picture."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from pipeline.messages import FloatArray

#: COCO samples precision at recalls 0, .01, .. 1
_RECALLS = np.linspace(0.0, 1.0, 101)
_TINY = np.spacing(1.0)


@numba.njit(cache=True, nogil=True)
def weighted_precision(
    right: NDArray[np.bool_], ignored: NDArray[np.bool_], weight: FloatArray, total: float
) -> tuple[float, float]:
    """AP and greatest recall at one IoU threshold.

    right, ignored, weight (D,), by falling score. total: weight of what is to be found, positive.
    This is COCOeval.accumulate, where a weight of 2 stands for a picture that comes twice.
    """
    precision, recall = np.empty(len(right)), np.empty(len(right))
    hits = misses = 0.0
    for d in range(len(right)):
        if not ignored[d]:
            if right[d]:
                hits += weight[d]
            else:
                misses += weight[d]
        precision[d], recall[d] = hits / (hits + misses + _TINY), hits / total
    for d in range(len(right) - 2, -1, -1):
        precision[d] = max(precision[d], precision[d + 1])
    area, d = 0.0, 0
    for level in _RECALLS:
        while d < len(right) and recall[d] < level:
            d += 1
        if d == len(right):
            break
        area += precision[d]
    return area / len(_RECALLS), hits / total
