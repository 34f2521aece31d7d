"""Non-maximum suppression: of boxes that overlap, only the one with the highest score stays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import FloatArray


def non_maximum_suppression(boxes: FloatArray, scores: FloatArray, iou_threshold: float) -> NDArray[np.int64]:
    """Indices of the boxes (N, 4) xyxy that stay, highest score first; equal scores in their given order.

    A box goes if its IoU with a box that stays and comes before it is greater than iou_threshold.
    """
    order = np.argsort(-scores, kind="stable")
    kept: list[int] = []
    while order.size:
        best, rest = int(order[0]), order[1:]
        kept.append(best)
        order = rest[iou(boxes[best], boxes[rest]) <= iou_threshold]
    return np.array(kept, np.int64)


def iou(box: FloatArray, boxes: FloatArray) -> FloatArray:
    """Intersection over union (N,) of one box (4,) with boxes (N, 4), xyxy; 0 where both are empty."""
    low, high = np.maximum(box[:2], boxes[:, :2]), np.minimum(box[2:], boxes[:, 2:])
    overlap = np.clip(high - low, 0.0, None).prod(axis=1)
    union = area(box[None]) + area(boxes) - overlap
    return np.divide(overlap, union, out=np.zeros_like(overlap), where=union > 0.0)


def area(boxes: FloatArray) -> FloatArray:
    """Areas (N,) of boxes (N, 4) xyxy."""
    return np.clip(boxes[:, 2:] - boxes[:, :2], 0.0, None).prod(axis=1)
