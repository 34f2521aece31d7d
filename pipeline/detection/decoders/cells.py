"""``kind: cells``: FastestDet (https://github.com/dog-qiuqiu/FastestDet), one grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.config.layout import Cells
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


def decode_cells(
    outputs: Outputs, size: tuple[int, int], layout: Cells, groups: Groups, least: float
) -> Candidates:
    """See decode."""
    values = outputs[layout.tensor]
    planes = values.reshape(values.shape[0], -1)
    cells, _ = grid(*size, (layout.stride,))

    def score_of(best: FloatArray, place: NDArray[np.int64]) -> FloatArray:
        with np.errstate(invalid="ignore"):
            return planes[0, place].astype(np.float64) ** 0.6 * best**0.4

    def boxes_of(place: NDArray[np.int64]) -> FloatArray:
        part = planes[1:5, place].T.astype(np.float64)
        centre = (cells[place] + np.tanh(part[:, :2])) * layout.stride
        return corners(np.concatenate([centre, np.array(size) * sigmoid(part[:, 2:])], axis=1), "cxcywh")

    return of_dense(planes[5:], groups, least, boxes_of, score_of)
