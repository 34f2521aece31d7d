"""What a detector finds on labelled pictures and what that is worth, in all and by what is known of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pipeline.detection import Detector
from pipeline.evaluation.metrics.average_precision import coco_precision
from pipeline.evaluation.metrics.bootstrap import replicate
from pipeline.evaluation.metrics.boxes import BoolArray, FoundBoxes, TrueBoxes, found_boxes, true_boxes
from pipeline.evaluation.metrics.cell import only
from pipeline.evaluation.metrics.matching import IOU_THRESHOLDS, Matches, match
from pipeline.messages import FloatArray
from pipeline.training.config import LabelledPictures
from pipeline.training.pictures import Image, PictureSet

#: the one category of labelled pictures
PERSON = 1
#: the overlap from which on a box is right
HALF = np.array([0.5])
_Boxes = TypeVar("_Boxes", TrueBoxes, FoundBoxes)
#: low enough that the average precision is not cut short
LOWEST_SCORE = 0.05


@dataclass(frozen=True, eq=False)
class Looked:
    """Truth and found boxes of N pictures, and what the labels say of each picture."""

    truth: TrueBoxes
    found: FoundBoxes
    attributes: tuple[dict[str, Any], ...]


def look(detector: Detector, pictures: PictureSet, images: Image) -> Looked:
    """What a detector that reports from LOWEST_SCORE on finds in the clean or the degraded images of a set."""
    image_of, boxes, scores = [], [], []
    true_of, true, crowd = [], [], []
    for number, row in enumerate(pictures.numbers):
        found, score, _ = detector.detect(np.asarray(images[row]))
        image_of.append(np.full(len(score), number))
        boxes.append(found)
        scores.append(score)
        true_of.append(np.full(len(pictures.boxes_px[row]), number))
        true.append(pictures.boxes_px[row])
        crowd.append(pictures.visible_shares[row] == 0.0)
    own, found_all, true_all = np.concatenate(image_of), np.concatenate(boxes), np.concatenate(true)
    return Looked(
        true_boxes(
            np.concatenate(true_of), np.full(len(true_all), PERSON), _xywh(true_all), None,
            np.concatenate(crowd),
        ),
        found_boxes(own, np.full(len(own), PERSON), _xywh(found_all), np.concatenate(scores)),
        tuple(pictures.attributes[row] for row in pictures.numbers),
    )  # fmt: skip


def together(parts: Sequence[Looked]) -> Looked:
    """All pictures of some looks as one."""
    starts = np.cumsum([0, *(len(p.attributes) for p in parts)])[:-1]
    truth = [replace(p.truth, image=p.truth.image + n) for p, n in zip(parts, starts, strict=True)]
    found = [replace(p.found, image=p.found.image + n) for p, n in zip(parts, starts, strict=True)]
    attributes = tuple(own for p in parts for own in p.attributes)
    return Looked(_joined(truth), _joined(found), attributes)


def accuracy(looked: Looked, threshold: float) -> dict[str, Any]:
    """AP .5, AP .5:.95; at the threshold recall, precision, and wrong boxes for each picture."""
    images = len(looked.attributes)
    precision = coco_precision(looked.truth, looked.found, images, [PERSON]).by_size["all"]
    _, right = counted(match(looked.truth, looked.found, "all", HALF), threshold)
    people, hits = int((~looked.truth.crowd).sum()), int(right.sum())
    return {
        "pictures": images,
        "people": people,
        "ap50": _rounded(precision.ap50),
        "ap": _rounded(precision.ap),
        "recall": _rounded(hits / people) if people else None,
        "precision": _rounded(hits / len(right)) if len(right) else None,
        "wrong_boxes_per_picture": _rounded((len(right) - hits) / images),
    }


def by_attribute(looked: Looked, data: LabelledPictures, threshold: float) -> dict[str, Any]:
    """accuracy of the pictures of each value, or range of values, of the keys that the training file names."""
    out: dict[str, Any] = {}
    for key, edges in data.by.items():
        values = [own.get(key) for own in looked.attributes]
        out[key] = {
            name: accuracy(_of(looked, chosen), threshold)
            for name, chosen in _classes(values, edges)
            if chosen.any()
        }
    return out


def by_size(looked: Looked, edges: tuple[float, ...]) -> dict[str, Any]:
    """AP .5 of the people of each size: square root of the box's area, pixels. As in COCO's classes, a size on an
    edge is in both.
    """
    out: dict[str, Any] = {}
    every = np.ones((1, len(looked.attributes)))
    for low, high in pairwise([0.0, *edges, np.inf]):
        matches = match(looked.truth, looked.found, (low**2, high**2), IOU_THRESHOLDS)
        people = len(matches.true_image)
        ap50 = float(replicate(matches, every).ap50[0]) if people else float("nan")
        out[_range_name(low, high)] = {"people": people, "ap50": _rounded(ap50)}
    return out


def counted(matches: Matches, threshold: float) -> tuple[FloatArray, BoolArray]:
    """Scores of the found boxes that count, and which are right."""
    counted = ~matches.ignored[0] & (matches.score >= threshold)
    return matches.score[counted], matches.right[0, counted]


def _joined(parts: Sequence[_Boxes]) -> _Boxes:
    columns = {f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(parts[0])}
    return replace(parts[0], **columns)


def _classes(values: list[Any], edges: tuple[float, ...]) -> list[tuple[str, BoolArray]]:
    """Names and members of the classes of values; without edges each value is one."""
    if not edges:
        return [(str(v), np.array([w == v for w in values])) for v in sorted(set(values), key=str)]
    numbers = np.array([np.nan if v is None else float(v) for v in values])
    return [
        (_range_name(low, high), (numbers >= low) & (numbers < high))
        for low, high in pairwise([-np.inf, *edges, np.inf])
    ]


def _range_name(low: float, high: float) -> str:
    if low in (0.0, -np.inf):
        return f"below {high:g}"
    return f"from {low:g}" if high == np.inf else f"{low:g} to {high:g}"


def _of(looked: Looked, chosen: BoolArray) -> Looked:
    numbers = np.flatnonzero(chosen)
    return Looked(
        only(looked.truth, numbers), only(looked.found, numbers), tuple(looked.attributes[i] for i in numbers)
    )


def _xywh(boxes: NDArray[np.float64]) -> FloatArray:
    return np.hstack([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]])


def _rounded(value: float) -> float | None:
    return round(value, 3) if np.isfinite(value) else None
