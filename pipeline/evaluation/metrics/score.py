"""AP, AR and LRP of detections in COCO's own files, class by class."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.config.evaluation import FaultPolicy
from pipeline.errors import InputError
from pipeline.evaluation.datasets.coco_format import (
    CocoAnnotation,
    CocoId,
    CocoResult,
    parsed,
    validated,
    validated_results,
)
from pipeline.evaluation.datasets.coco_rows import in_order, listed, places, unique
from pipeline.evaluation.datasets.fault_log import FaultLog
from pipeline.evaluation.metrics.average_precision import coco_precision
from pipeline.evaluation.metrics.boxes import FoundBoxes, TrueBoxes, found_boxes, true_boxes
from pipeline.evaluation.metrics.lrp import OptimalLrp, lrp_curve, mean_optimal_lrp, optimal_lrp
from pipeline.evaluation.metrics.matching import match

_CLASSES = ("class", "to find", "AP .5:.95", "oLRP", "IoU", "FP", "FN", "threshold")
_SIZES = ("size", "AP .5:.95", "AP .5", "AP .75", "AR 1", "AR 10", "AR 100")


@dataclass(frozen=True)
class Scored:
    """Two tables, their first rows the heads: by class, with the mean over those with truth; and by size.

    faults: lines about what was left out.
    """

    classes: list[tuple[str, ...]]
    sizes: list[tuple[str, ...]]
    faults: list[str]


def score_files(truth: Path, results: Path) -> Scored:
    """See Scored. As COCO's own code does, boxes of a category that is not listed are left out; that is said.

    Raises InputError for files that are not what they should be.
    """
    document = validated(parsed(truth), truth)
    found = validated_results(parsed(results), results)
    faults = FaultLog(FaultPolicy(unknown_category="skip"))
    images = unique(document.images, truth, "images", faults)
    categories = in_order(unique(document.categories, truth, "categories", faults))
    numbers = Numbers(
        {image.id: k for k, image in enumerate(in_order(images))},
        {category.id: k for k, category in enumerate(categories)},
    )
    true = _true(places(document.annotations, truth, faults), numbers, faults)
    boxes = _found([(f"{results} {k}", row) for k, row in enumerate(found)], numbers, faults)
    classes, sizes = _tables(true, boxes, len(images), [category.name for category in categories])
    return Scored(classes, sizes, faults.lines())


@dataclass(frozen=True)
class Numbers:
    """Of pictures and of categories, by id: whatever the ids are, the metrics count from 0."""

    image: dict[CocoId, int]
    category: dict[CocoId, int]


def _true(rows: list[tuple[str, CocoAnnotation]], numbers: Numbers, faults: FaultLog) -> TrueBoxes:
    kept = [row for _, row in _listed(rows, numbers, faults)]
    return true_boxes(
        [numbers.image[a.image_id] for a in kept],
        [numbers.category[a.category_id] for a in kept],
        [a.bbox for a in kept],
        [a.bbox[2] * a.bbox[3] if a.area is None else a.area for a in kept],
        [bool(a.iscrowd) for a in kept],
    )


def _found(rows: list[tuple[str, CocoResult]], numbers: Numbers, faults: FaultLog) -> FoundBoxes:
    kept = [row for _, row in _listed(rows, numbers, faults)]
    return found_boxes(
        [numbers.image[r.image_id] for r in kept],
        [numbers.category[r.category_id] for r in kept],
        [r.bbox for r in kept],
        [r.score for r in kept],
    )


def _listed(
    rows: Sequence[tuple[str, CocoAnnotation | CocoResult]], numbers: Numbers, faults: FaultLog
) -> Iterator[tuple[str, Any]]:
    for where, row in listed(rows, numbers.image, numbers.category, faults):
        if not all(map(math.isfinite, row.bbox)) or min(row.bbox[2:]) < 0.0:
            raise InputError(f"{where}.bbox", str(list(row.bbox)), "x, y, width, height, sizes of 0 or more")
        yield where, row


def _tables(
    true: TrueBoxes, found: FoundBoxes, images: int, names: list[str]
) -> tuple[list[tuple[str, ...]], list[tuple[str, ...]]]:
    coco = coco_precision(true, found, images, list(range(len(names))))
    matches = match(true, found, "all", np.array([0.5]))
    optima = {c: optimal_lrp(lrp_curve(matches, c)) for c in range(len(names))}
    classes: list[tuple[str, ...]] = [_CLASSES]
    for c, name in enumerate(names):
        count = int(np.count_nonzero(matches.true_category == c))
        if count:
            classes.append((name, str(count), _text(coco.ap_by_category[c]), *_parts(optima[c])))
    mean = mean_optimal_lrp(list(optima.values()))
    classes.append(("mean", str(len(matches.true_image)), _text(coco.by_size["all"].ap), *_parts(mean)))
    sizes: list[tuple[str, ...]] = [_SIZES]
    for size, p in coco.by_size.items():
        sizes.append((size, *map(_text, (p.ap, p.ap50, p.ap75, p.ar1, p.ar10, p.ar100))))
    return classes, sizes


def _parts(lrp: OptimalLrp) -> tuple[str, ...]:
    values = (lrp.lrp, lrp.localisation, lrp.false_positive, lrp.false_negative, lrp.threshold)
    return tuple(map(_text, values))


def _text(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.10f}" if math.isfinite(value) else "none"
