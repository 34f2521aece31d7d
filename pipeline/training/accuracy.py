"""How well a detector finds people: COCO's average precision, and how far off the boxes' bottom edges are."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import hotcoco
import numpy as np
from numpy.typing import NDArray

from pipeline.detection import Detector
from pipeline.detection.nms import iou
from pipeline.messages import FloatArray

#: people less visible are neither right nor wrong
VISIBLE_MIN = 0.3
_SIZES = ("small", "medium", "large")
_AREA_EDGES = (32.0**2, 96.0**2)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Of one picture: true boxes (N, 4) xyxy, their visible shares (N,), found boxes (M, 4), scores (M,)."""

    size: tuple[int, int]
    true: FloatArray
    visible: FloatArray
    found: FloatArray
    scores: FloatArray


@dataclass(frozen=True, slots=True)
class Accuracy:
    """ap: COCO's AP .5:.95. score: the threshold with the greatest F1 at IoU 0.5.

    recall, precision, bottom_edge_px (mean error of the found boxes' bottom edges): at that score.
    ap_small, ap_medium, ap_large: AP .5:.95 of people whose box is up to 32^2, 96^2, or more pixels of the
    picture large; NaN if there are none.
    """

    pictures: int
    people: int
    ap50: float
    ap75: float
    ap: float
    ap_small: float
    ap_medium: float
    ap_large: float
    score: float
    recall: float
    precision: float
    bottom_edge_px: float


def look(
    detector: Detector, pictures: Iterable[tuple[NDArray[np.uint8], FloatArray, FloatArray]]
) -> list[Seen]:
    """What a detector finds in pictures (H, W, 3) with their true boxes and visible shares.

    The detector should report down to low scores, or the average precision is cut short.
    """
    seen = []
    for image, true, visible in pictures:
        boxes, scores, _ = detector.detect(np.asarray(image))
        seen.append(Seen((image.shape[1], image.shape[0]), true, visible, boxes, scores))
    return seen


def accuracy(seen: list[Seen]) -> Accuracy:
    """The accuracy over all pictures."""
    people = sum(int((s.visible >= VISIBLE_MIN).sum()) for s in seen)
    scores, right, edges = _judged(seen)
    score, recall, precision = _operating_point(scores, right, people)
    return Accuracy(
        pictures=len(seen),
        people=people,
        **_average_precision(seen),
        score=score,
        recall=recall,
        precision=precision,
        bottom_edge_px=float(edges[right & (scores >= score)].mean()) if right.any() else float("nan"),
    )


def _judged(seen: list[Seen]) -> tuple[FloatArray, NDArray[np.bool_], FloatArray]:
    """_judge of all pictures, one after the other."""
    scores, right, edges = zip(*map(_judge, seen), strict=True)
    return np.concatenate(scores), np.concatenate(right), np.concatenate(edges)


def _judge(seen: Seen) -> tuple[FloatArray, NDArray[np.bool_], FloatArray]:
    """Of the found boxes that count: scores, which are right, and the bottom edges' errors (NaN if wrong).

    By falling score each box takes the free person that it overlaps most, at IoU 0.5 or more.
    """
    free = np.ones(len(seen.true), bool)
    person = np.full(len(seen.found), -1)
    for found in np.argsort(-seen.scores, kind="stable"):
        overlap = np.where(free, iou(seen.found[found], seen.true), 0.0)
        if overlap.size and overlap.max() >= 0.5:
            person[found] = overlap.argmax()
            free[person[found]] = False
    edges = np.full(len(person), np.nan)
    edges[person >= 0] = np.abs(seen.found[person >= 0, 3] - seen.true[person[person >= 0], 3])
    hidden = np.append(seen.visible < VISIBLE_MIN, False)
    counts = ~hidden[person]
    return seen.scores[counts], person[counts] >= 0, edges[counts]


def _operating_point(scores: FloatArray, right: NDArray[np.bool_], people: int) -> tuple[float, float, float]:
    """The score with the greatest F1, and recall and precision at it."""
    if not right.any():
        return float("nan"), 0.0, float("nan")
    order = np.argsort(-scores, kind="stable")
    hits = np.cumsum(right[order])
    best = int(np.argmax(2.0 * hits / (people + np.arange(1, len(order) + 1))))
    return float(scores[order[best]]), float(hits[best] / people), float(hits[best] / (best + 1))


def people_by_size(seen: list[Seen]) -> dict[str, int]:
    """How many people that count are of each of COCO's sizes."""
    boxes = np.concatenate([s.true[s.visible >= VISIBLE_MIN] for s in seen])
    area = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
    counts = np.histogram(area, [0.0, *_AREA_EDGES, np.inf])[0]
    return dict(zip(_SIZES, map(int, counts), strict=True))


def _average_precision(seen: list[Seen]) -> dict[str, float]:
    """AP .5:.95 of all and by size, AP .5 and AP .75; what COCO reports as -1 is NaN."""
    image = np.repeat(np.arange(len(seen)), [len(s.true) for s in seen])
    true = _xywh([s.true for s in seen])
    truth = hotcoco.COCO.from_arrays(
        [{"id": i} for i in range(len(seen))],
        [{"id": 1, "name": "person"}],
        image,
        np.ones(len(image), np.int64),
        true,
        iscrowd=np.concatenate([s.visible for s in seen]) < VISIBLE_MIN,
    )
    scores = np.concatenate([s.scores for s in seen])
    of_image = np.repeat(np.arange(len(seen)), [len(s.found) for s in seen])
    found = np.column_stack([of_image, _xywh([s.found for s in seen]), scores, np.ones(len(scores))])
    evaluation = hotcoco.COCOeval(truth, truth.load_res(found), "bbox")
    evaluation.evaluate()
    evaluation.accumulate()
    assert evaluation.eval is not None
    # precision (T, R, K, A, M): IoU, recall, category, area, most boxes; -1: no truth
    precision = evaluation.eval["precision"][:, :, 0, :, -1]
    whole = {"ap": precision[:, :, 0], "ap50": precision[0, :, 0], "ap75": precision[5, :, 0]}
    of_sizes = {f"ap_{size}": precision[:, :, a] for a, size in enumerate(_SIZES, 1)}
    return {name: _known_mean(values) for name, values in (whole | of_sizes).items()}


def _known_mean(values: FloatArray) -> float:
    known = values[values > -1.0]
    return float(known.mean()) if known.size else float("nan")


def _xywh(boxes: list[FloatArray]) -> FloatArray:
    xyxy = np.concatenate([np.asarray(b, np.float64).reshape(-1, 4) for b in boxes])
    return np.hstack([xyxy[:, :2], xyxy[:, 2:] - xyxy[:, :2]])
