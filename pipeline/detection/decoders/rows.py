"""``kind: rows``: the YOLO family, box, objectness and class scores beside each other."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.config.layout import Rows
from pipeline.detection.decoders.candidates import (
    Candidates,
    Groups,
    Outputs,
    corners,
    grid,
    of_dense,
    sigmoid,
)
from pipeline.messages import FloatArray


def decode_rows(
    outputs: Outputs, size: tuple[int, int], rows: Rows, groups: Groups, least: float
) -> Candidates:
    """See decode."""
    values = outputs[rows.tensor]
    columns = values if rows.order == "columns" else values.T
    first = 5 if rows.objectness else 4

    def score_of(best: FloatArray, place: NDArray[np.int64]) -> FloatArray:
        certain = columns[4, place].astype(np.float64) if rows.objectness else None
        if rows.activation == "sigmoid":
            best = sigmoid(best)
            certain = None if certain is None else sigmoid(certain)
        return best if certain is None else best * certain

    def boxes_of(place: NDArray[np.int64]) -> FloatArray:
        return _boxes(columns[:4, place].T, place, size, rows)

    return of_dense(columns[first:], groups, least, boxes_of, score_of)


def _boxes(values: NDArray[Any], place: NDArray[np.int64], size: tuple[int, int], rows: Rows) -> FloatArray:
    boxes = np.asarray(values, np.float64)
    if rows.grid == "yolox":
        cells, stride = grid(*size, rows.strides)
        with np.errstate(over="ignore"):
            boxes = (
                np.concatenate([boxes[:, :2] + cells[place], np.exp(boxes[:, 2:])], axis=1) * stride[place]
            )
    if rows.unit == "shares":
        boxes = boxes * np.array([*size, *size], float)
    return corners(boxes, rows.box)
