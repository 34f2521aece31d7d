"""``kind: chosen``: objects that the graph has chosen already, by NMS or a set of queries."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.config.layout import BoxForm, Chosen
from pipeline.detection.decoders.candidates import Candidates, Groups, Outputs, corners, of_labelled
from pipeline.messages import FloatArray

_FORMS: tuple[tuple[BoxForm, tuple[str, ...]], ...] = (
    ("xyxy", ("x0", "y0", "x1", "y1")),
    ("cxcywh", ("cx", "cy", "w", "h")),
    ("xywh", ("x0", "y0", "w", "h")),
)


def decode_chosen(
    outputs: Outputs, size: tuple[int, int], chosen: Chosen, groups: Groups, least: float
) -> Candidates:
    """See decode."""
    boxes, scores, labels = _parts(outputs, chosen)
    valid = len(scores)
    if chosen.count is not None:
        valid = min(valid, max(0, int(outputs[chosen.count].ravel()[0])))
    boxes, scores, labels = boxes[:valid], scores[:valid].astype(np.float64), labels[:valid]
    if chosen.unit == "shares":
        boxes = boxes * np.array([*size, *size], float)
    return of_labelled(boxes, scores, labels, groups, least)


def _parts(outputs: Outputs, chosen: Chosen) -> tuple[FloatArray, NDArray[Any], NDArray[Any]]:
    """Boxes (N, 4) xyxy, scores (N,), labels (N,)."""
    columns = chosen.columns
    if columns:
        table = outputs[chosen.rows or chosen.boxes or ""].reshape(-1, len(columns))
        form, names = next((f, n) for f, n in _FORMS if set(n) <= set(columns))
        boxes = corners(table[:, [columns.index(name) for name in names]], form)
        scores = table[:, columns.index("score")]
        if chosen.labels is not None:
            return boxes, scores, outputs[chosen.labels].reshape(-1)
        labels = table[:, columns.index("class")] if "class" in columns else np.zeros(len(table))
        return boxes, scores, _whole(labels)
    boxes = corners(outputs[chosen.boxes or ""].reshape(-1, 4), chosen.box)
    scores = outputs[chosen.scores or ""].reshape(-1)
    labels = np.zeros(len(scores)) if chosen.labels is None else outputs[chosen.labels].reshape(-1)
    return boxes, scores, _whole(labels)


def _whole(labels: NDArray[Any]) -> NDArray[np.int64]:
    finite = np.where(np.isfinite(labels), labels, -1)
    return np.rint(np.clip(finite, -1, 1e6)).astype(np.int64)
