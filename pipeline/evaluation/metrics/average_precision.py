"""COCO's average precision and recall, by hotcoco: the fastest that was measured, equal to pycocotools'."""

from __future__ import annotations

from dataclasses import dataclass

import hotcoco
import numpy as np

from pipeline.evaluation.metrics.boxes import FoundBoxes, TrueBoxes
from pipeline.evaluation.metrics.matching import AREAS, Size
from pipeline.messages import FloatArray

SIZES: tuple[Size, ...] = tuple(AREAS)
#: COCO's numbers of boxes per picture
MOST_FOUND = (1, 10, 100)


@dataclass(frozen=True, slots=True)
class Precision:
    """Of one size class, means over the categories; NaN if there is nothing to find.

    ap: AP .5:.95. ap50, ap75: at one IoU. ar1, ar10, ar100: AR .5:.95 with so many boxes for each picture.
    """

    ap: float
    ap50: float
    ap75: float
    ar1: float
    ar10: float
    ar100: float


@dataclass(frozen=True, slots=True)
class CocoResult:
    """by_size: over all categories. ap_by_category: AP .5:.95 of boxes of every size, by category."""

    by_size: dict[Size, Precision]
    ap_by_category: dict[int, float]


def coco_precision(true: TrueBoxes, found: FoundBoxes, images: int, categories: list[int]) -> CocoResult:
    """AP and AR over pictures 0 .. images - 1, by COCO's rules."""
    truth = hotcoco.COCO.from_arrays(
        [{"id": i} for i in range(images)],
        [{"id": c, "name": str(c)} for c in categories],
        true.image,
        true.category,
        true.bbox,
        area=true.area,
        iscrowd=true.crowd,
    )
    columns = (found.image, found.bbox, found.score, found.category)
    evaluation = hotcoco.COCOeval(truth, truth.load_res(np.column_stack(columns)), "bbox")
    evaluation.evaluate()
    evaluation.accumulate()
    assert evaluation.eval is not None
    # precision (T, R, K, A, M), recall (T, K, A, M): IoU, recall, category, area, most boxes; -1: no truth
    precision, recall = evaluation.eval["precision"], evaluation.eval["recall"]
    return CocoResult(
        {size: _of_size(precision[:, :, :, a], recall[:, :, a]) for a, size in enumerate(SIZES)},
        {c: _mean(precision[:, :, k, 0, -1]) for k, c in enumerate(sorted(categories))},
    )


def _of_size(precision: FloatArray, recall: FloatArray) -> Precision:
    return Precision(
        ap=_mean(precision[..., -1]),
        ap50=_mean(precision[0, ..., -1]),
        ap75=_mean(precision[5, ..., -1]),
        ar1=_mean(recall[..., 0]),
        ar10=_mean(recall[..., 1]),
        ar100=_mean(recall[..., 2]),
    )


def _mean(values: FloatArray) -> float:
    known = values[values > -1.0]
    return float(known.mean()) if known.size else float("nan")
