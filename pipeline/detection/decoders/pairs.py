"""``kind: pairs``: a tensor of boxes and one of scores; the DETR family, DAMO-YOLO, our own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.config.layout import Pairs
from pipeline.detection.decoders.candidates import (
    Candidates,
    Groups,
    Outputs,
    corners,
    of_dense,
    of_labelled,
    sigmoid,
)
from pipeline.messages import FloatArray


def decode_pairs(
    outputs: Outputs, size: tuple[int, int], pairs: Pairs, groups: Groups, least: float
) -> Candidates:
    """See decode."""
    boxes, scores = outputs[pairs.boxes].reshape(-1, 4), outputs[pairs.scores]
    if scores.ndim == 1:
        scores = scores[:, None]
    classes = scores if pairs.scores_order == "columns" else scores.T
    if pairs.activation == "softmax":
        raised = np.exp(classes.astype(np.float64) - classes.max(axis=0))
        classes = (raised / raised.sum(axis=0))[:-1]

    def boxes_of(place: NDArray[np.int64]) -> FloatArray:
        some = boxes[place].astype(np.float64)
        if pairs.unit == "shares":
            some = some * np.array([*size, *size] if pairs.box != "yxyx" else [size[1], size[0]] * 2, float)
        return corners(some, pairs.box)

    def score_of(best: FloatArray, _: NDArray[np.int64]) -> FloatArray:
        return sigmoid(best) if pairs.activation == "sigmoid" else best

    if pairs.selected is None:
        return of_dense(classes, groups, least, boxes_of, score_of)
    chosen = outputs[pairs.selected].reshape(-1, 3)
    label, place = chosen[:, 1], chosen[:, 2]
    worth = score_of(classes[label, place].astype(np.float64), place)
    return of_labelled(boxes_of(place), worth, label, groups, least)
