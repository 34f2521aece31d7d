"""Which found box is which true one, by COCO's rules; everything else that is measured rests on this."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from pipeline.evaluation.metrics.boxes import BoolArray, FoundBoxes, IntArray, TrueBoxes
from pipeline.evaluation.metrics.matching_kernels import assign
from pipeline.messages import FloatArray

Size = Literal["all", "small", "medium", "large"]
#: COCO's size classes: least and greatest area in square pixels, both included
AREAS: dict[Size, tuple[float, float]] = {
    "all": (0.0, 1e10),
    "small": (0.0, 32.0**2),
    "medium": (32.0**2, 96.0**2),
    "large": (96.0**2, 1e10),
}
#: COCO's IoU thresholds .5, .55, .. .95
IOU_THRESHOLDS: FloatArray = np.linspace(0.5, 0.95, 10)
#: so many of the most certain boxes of a category in a picture count
MOST_FOUND = 100


@dataclass(frozen=True, eq=False)
class Matches:
    """The found boxes of one size class that count, D in all, by falling score.

    image, category: int64 (D,). score: float64 (D,). iou: float64 (T, D), with the true box that was found,
    0 if there is none. right: bool (T, D). ignored: bool (T, D), neither right nor wrong.
    true_image, true_category: int64 (N,), of the true boxes that are to be found.
    """

    image: IntArray
    category: IntArray
    score: FloatArray
    iou: FloatArray
    right: BoolArray
    ignored: BoolArray
    true_image: IntArray
    true_category: IntArray


def match(
    true: TrueBoxes,
    found: FoundBoxes,
    size: Size | tuple[float, float] = "all",
    iou_thresholds: FloatArray = IOU_THRESHOLDS,
    most_found: int = MOST_FOUND,
) -> Matches:
    """Assign found boxes to true ones as COCOeval does, for one size class, at T IoU thresholds.

    size: a class of COCO's, or the least and the greatest area in square pixels, both included. True boxes of
    another size are ignored, and so are found boxes of another size that match nothing.
    """
    low, high = AREAS[size] if isinstance(size, str) else size
    ignored = true.crowd | (true.area < low) | (true.area > high)
    found = _most_certain(found, most_found)
    order = np.lexsort((ignored, true.image, true.category))
    true, ignored = true.rows(order), ignored[order]
    found_starts, true_starts = _groups(found, true)
    partner = np.full((len(iou_thresholds), len(found)), -1, np.int64)
    iou = np.zeros(partner.shape)
    assign(
        found.bbox, found_starts, true.bbox, true_starts, true.crowd, ignored,
        np.ascontiguousarray(iou_thresholds, np.float64), partner, iou,
    )  # fmt: skip
    matched = partner >= 0
    area = found.bbox[:, 2] * found.bbox[:, 3]
    beyond = (area < low) | (area > high)
    skipped = np.where(matched, np.append(ignored, False)[partner], beyond)
    by_score = np.argsort(-found.score, kind="stable")
    return Matches(
        found.image[by_score],
        found.category[by_score],
        found.score[by_score],
        iou[:, by_score],
        (matched & ~skipped)[:, by_score],
        skipped[:, by_score],
        true.image[~ignored],
        true.category[~ignored],
    )


def _most_certain(found: FoundBoxes, most: int) -> FoundBoxes:
    """By category, picture and falling score, the first of each picture only."""
    found = found.rows(np.lexsort((-found.score, found.image, found.category)))
    starts = _starts(found.category, found.image)
    lengths = np.diff(np.append(starts, len(found)))
    rank = np.arange(len(found)) - np.repeat(starts, lengths)
    return found.rows(rank < most)


def _starts(category: IntArray, image: IntArray) -> IntArray:
    """Where in sorted columns a new category or picture begins."""
    if not len(category):
        return np.zeros(0, np.int64)
    new = (np.diff(category) != 0) | (np.diff(image) != 0)
    return np.concatenate([[0], np.flatnonzero(new) + 1])


def _groups(found: FoundBoxes, true: TrueBoxes) -> tuple[IntArray, IntArray]:
    """Bounds (G + 1,) of the found and of the true boxes of each picture and category; both are sorted."""
    images = 1 + max(int(found.image.max(initial=0)), int(true.image.max(initial=0)))
    keys = np.concatenate([b.category * images + b.image for b in (found, true)])
    _, group = np.unique(keys, return_inverse=True)
    edges = np.arange(int(group.max(initial=-1)) + 2)
    return np.searchsorted(group[: len(found)], edges), np.searchsorted(group[len(found) :], edges)
