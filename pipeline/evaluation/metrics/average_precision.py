"""COCO's average precision and recall, by faster-coco-eval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from faster_coco_eval import COCO, COCOeval_faster

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
    truth = COCO(_truth(true, images, categories))
    # the library cannot load a list without a box
    results = (
        truth.loadRes(_results(found))
        if len(found)
        else COCO(_truth(true.rows(true.image < 0), images, categories))
    )
    evaluation = COCOeval_faster(truth, results, "bbox", print_function=lambda *_: None)
    evaluation.evaluate()
    evaluation.accumulate()
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


def _truth(true: TrueBoxes, images: int, categories: list[int]) -> dict[str, Any]:
    columns = zip(
        true.image.tolist(),
        true.category.tolist(),
        true.bbox.tolist(),
        true.area.tolist(),
        true.crowd.tolist(),
        strict=True,
    )
    return {
        "info": {},
        "images": [{"id": i} for i in range(images)],
        "categories": [{"id": c} for c in categories],
        "annotations": [
            {"id": k, "image_id": i, "category_id": c, "bbox": b, "area": a, "iscrowd": int(crowd)}
            for k, (i, c, b, a, crowd) in enumerate(columns, 1)
        ],
    }


def _results(found: FoundBoxes) -> list[dict[str, Any]]:
    columns = zip(
        found.image.tolist(), found.category.tolist(), found.bbox.tolist(), found.score.tolist(), strict=True
    )
    return [{"image_id": i, "category_id": c, "bbox": b, "score": s} for i, c, b, s in columns]
