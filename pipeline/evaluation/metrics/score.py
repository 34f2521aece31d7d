"""AP, AR and LRP of detections in COCO's own files, class by class."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.errors import InputError
from pipeline.evaluation.metrics.average_precision import coco_precision
from pipeline.evaluation.metrics.boxes import FoundBoxes, TrueBoxes, found_boxes, true_boxes
from pipeline.evaluation.metrics.lrp import OptimalLrp, lrp_curve, mean_optimal_lrp, optimal_lrp
from pipeline.evaluation.metrics.matching import match

_CLASSES = ("class", "to find", "AP .5:.95", "oLRP", "IoU", "FP", "FN", "threshold")
_SIZES = ("size", "AP .5:.95", "AP .5", "AP .75", "AR 1", "AR 10", "AR 100")


def score_files(truth: Path, results: Path) -> tuple[list[tuple[str, ...]], list[tuple[str, ...]]]:
    """Two tables, their first rows the heads: by class, with the mean over those with truth; and by size.

    Raises InputError for files that are not what they should be.
    """
    document, found = _json(truth), _json(results)
    try:
        names = {c["id"]: str(c["name"]) for c in document["categories"]}
        index = {i["id"]: k for k, i in enumerate(sorted(document["images"], key=lambda i: i["id"]))}
        true = _true(document["annotations"], index, truth)
        boxes = _found(found, index, results)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            truth, f"a field that is missing or no number ({error!r})", "COCO's format"
        ) from None
    return _tables(true, boxes, len(index), names)


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(path, f"no readable file ({error.strerror})", "a JSON file") from None
    except ValueError as error:
        raise InputError(path, f"text that is not JSON ({error})", "a JSON file") from None


def _true(annotations: list[Any], index: dict[Any, int], where: Path) -> TrueBoxes:
    for a in annotations:
        if a["image_id"] not in index:
            at = f"{where} annotations.id={a.get('id')}.image_id"
            raise InputError(at, f"{a['image_id']}, no listed picture", "an id in images")
    return true_boxes(
        [index[a["image_id"]] for a in annotations],
        [a["category_id"] for a in annotations],
        [a["bbox"] for a in annotations],
        [a.get("area", a["bbox"][2] * a["bbox"][3]) for a in annotations],
        [bool(a.get("iscrowd", 0)) for a in annotations],
    )


def _found(results: list[Any], index: dict[Any, int], where: Path) -> FoundBoxes:
    for k, r in enumerate(results):
        if r["image_id"] not in index:
            raise InputError(
                f"{where} {k}.image_id", f"{r['image_id']}, no listed picture", "an id in images"
            )
        if not all(map(math.isfinite, (*r["bbox"], r["score"]))):
            raise InputError(f"{where} {k}", "a box or score that is not a number", "numbers")
    return found_boxes(
        [index[r["image_id"]] for r in results],
        [r["category_id"] for r in results],
        [r["bbox"] for r in results],
        [r["score"] for r in results],
    )


def _tables(
    true: TrueBoxes, found: FoundBoxes, images: int, names: dict[int, str]
) -> tuple[list[tuple[str, ...]], list[tuple[str, ...]]]:
    coco = coco_precision(true, found, images, sorted(names))
    matches = match(true, found, "all", np.array([0.5]))
    optima = {c: optimal_lrp(lrp_curve(matches, c)) for c in names}
    classes: list[tuple[str, ...]] = [_CLASSES]
    for c, name in names.items():
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
