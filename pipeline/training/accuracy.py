"""How well a detector finds people: COCO's average precision, and how far off the boxes' bottom edges are."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from faster_coco_eval import COCO, COCOeval_faster
from numpy.typing import NDArray

from pipeline.detection import Detector
from pipeline.detection.nms import iou
from pipeline.messages import FloatArray

#: detections below are not reported by the shipped pools, and so their edges do not matter
SCORE_THRESHOLD = 0.3
#: people less visible are neither right nor wrong
VISIBLE_MIN = 0.3


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
    """ap: COCO's AP .5:.95. recall, precision: at SCORE_THRESHOLD and IoU 0.5. bottom_edge_px: mean error."""

    pictures: int
    people: int
    ap50: float
    ap75: float
    ap: float
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
    clear = [s.visible >= VISIBLE_MIN for s in seen]
    ap, ap50, ap75 = _average_precision(seen)
    pairs = [_matches(s) for s in seen]
    right = sum(int(clear[i][pair[:, 0]].sum()) for i, pair in enumerate(pairs))
    wrong = sum(int((s.scores >= SCORE_THRESHOLD).sum()) for s in seen) - sum(len(pair) for pair in pairs)
    errors = [
        np.abs(s.true[pair[:, 0], 3] - s.found[pair[:, 1], 3])[c[pair[:, 0]]]
        for s, pair, c in zip(seen, pairs, clear, strict=True)
    ]
    people = int(sum(c.sum() for c in clear))
    return Accuracy(
        pictures=len(seen),
        people=people,
        ap50=ap50,
        ap75=ap75,
        ap=ap,
        recall=right / people if people else float("nan"),
        precision=right / (right + wrong) if right + wrong else float("nan"),
        bottom_edge_px=float(np.concatenate(errors).mean()) if right else float("nan"),
    )


def _matches(seen: Seen) -> NDArray[np.int64]:
    """Pairs (true, found) with IoU at least 0.5, by falling score, each used once."""
    free = np.ones(len(seen.true), bool)
    pairs = []
    for found in np.flatnonzero(seen.scores >= SCORE_THRESHOLD):
        overlap = np.where(free, iou(seen.found[found], seen.true), 0.0)
        if overlap.size and overlap.max() >= 0.5:
            best = int(overlap.argmax())
            free[best] = False
            pairs.append((best, int(found)))
    return np.array(pairs, np.int64).reshape(-1, 2)


def _average_precision(seen: list[Seen]) -> tuple[float, float, float]:
    """AP .5:.95, AP .5 and AP .75."""
    found = [
        {"image_id": i, "category_id": 1, "bbox": _xywh(box), "score": float(score)}
        for i, s in enumerate(seen)
        for box, score in zip(s.found, s.scores, strict=True)
    ]
    if not found:
        return 0.0, 0.0, 0.0
    truth = COCO(_coco(seen))
    evaluation = COCOeval_faster(truth, truth.loadRes(found), "bbox", print_function=lambda *_: None)
    evaluation.run()
    ap, ap50, ap75 = (float(x) for x in evaluation.stats[:3])
    return ap, ap50, ap75


def _coco(seen: list[Seen]) -> dict[str, Any]:
    annotations = [
        {"image_id": i, "category_id": 1, "bbox": _xywh(box), "area": _xywh(box)[2] * _xywh(box)[3]}
        | {"iscrowd": int(share < VISIBLE_MIN), "ignore": int(share < VISIBLE_MIN)}
        for i, s in enumerate(seen)
        for box, share in zip(s.true, s.visible, strict=True)
    ]
    return {
        "info": {},
        "images": [{"id": i, "width": s.size[0], "height": s.size[1]} for i, s in enumerate(seen)],
        "categories": [{"id": 1, "name": "person"}],
        "annotations": [a | {"id": i + 1} for i, a in enumerate(annotations)],
    }


def _xywh(box: FloatArray) -> list[float]:
    return [float(box[0]), float(box[1]), float(box[2] - box[0]), float(box[3] - box[1])]
