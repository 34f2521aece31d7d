"""True and found boxes as columns, as the metrics take them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import FloatArray

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class _Columns:
    """Columns of equal length that can be chosen from row by row."""

    def rows(self, wanted: BoolArray | IntArray) -> Self:
        """The wanted rows, in the given order."""
        chosen = {f.name: getattr(self, f.name)[wanted] for f in fields(self)}  # type: ignore[arg-type]
        return replace(self, **chosen)  # type: ignore[type-var]

    def __len__(self) -> int:
        return len(self.image)  # type: ignore[attr-defined]


@dataclass(frozen=True, eq=False)
class TrueBoxes(_Columns):
    """The truth, one row for each of N boxes.

    image: int64 (N,), number of the picture. category: int64 (N,). bbox: float64 (N, 4), x, y, width, height
    in pixels. area: float64 (N,), square pixels, what COCO's size classes go by. crowd: bool (N,), COCO's
    iscrowd: an ignore region, where detections are neither right nor wrong.
    """

    image: IntArray
    category: IntArray
    bbox: FloatArray
    area: FloatArray
    crowd: BoolArray


@dataclass(frozen=True, eq=False)
class FoundBoxes(_Columns):
    """What a detector found, one row for each of N boxes; score: float64 (N,); the others as in TrueBoxes."""

    image: IntArray
    category: IntArray
    bbox: FloatArray
    score: FloatArray


def true_boxes(
    image: object, category: object, bbox: object, area: object = None, crowd: object = None
) -> TrueBoxes:
    """TrueBoxes of anything array-like. area: by default of the box. crowd: by default none is."""
    boxes = np.asarray(bbox, np.float64).reshape(-1, 4)
    return TrueBoxes(
        np.asarray(image, np.int64).reshape(-1),
        np.asarray(category, np.int64).reshape(-1),
        boxes,
        boxes[:, 2] * boxes[:, 3] if area is None else np.asarray(area, np.float64).reshape(-1),
        np.zeros(len(boxes), bool) if crowd is None else np.asarray(crowd, bool).reshape(-1),
    )


def found_boxes(image: object, category: object, bbox: object, score: object) -> FoundBoxes:
    """FoundBoxes of anything array-like."""
    return FoundBoxes(
        np.asarray(image, np.int64).reshape(-1),
        np.asarray(category, np.int64).reshape(-1),
        np.asarray(bbox, np.float64).reshape(-1, 4),
        np.asarray(score, np.float64).reshape(-1),
    )
