"""``kind: distances``: NanoDet, NanoDet-Plus and PicoDet, distributions of the distances to the edges.

Li et al., Generalized Focal Loss (2020): the mean of a distribution over whole distances in cells.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.config.layout import Distances
from pipeline.detection.decoders.candidates import Candidates, Groups, Outputs, grid, of_dense, sigmoid
from pipeline.messages import FloatArray


def decode_distances(
    outputs: Outputs, size: tuple[int, int], layout: Distances, groups: Groups, least: float
) -> Candidates:
    """See decode."""
    wide = 4 * layout.bins
    if layout.tensor is not None:
        both = outputs[layout.tensor]
        classes, spread = both[:, :-wide].T, [both[:, -wide:]]
    else:
        some: slice | list[int] = slice(None)
        if groups is not None:  # the other classes need not be copied
            some = sorted({member for group in groups for member in group})
            groups = tuple(tuple(some.index(member) for member in group) for group in groups)
        classes = np.concatenate([outputs[name][:, some].T for name in layout.scores], axis=1)
        spread = [outputs[name] for name in layout.distances]
    cells, stride = grid(*size, layout.strides)

    def boxes_of(place: NDArray[np.int64]) -> FloatArray:
        bins = np.concatenate(spread)[place].astype(np.float64).reshape(-1, 4, layout.bins)
        weights = np.exp(bins - bins.max(axis=2, keepdims=True))
        away = stride[place] * (weights @ np.arange(layout.bins)) / weights.sum(axis=2)
        middle = (cells[place] + layout.centre) * stride[place]
        return np.concatenate([middle - away[:, :2], middle + away[:, 2:]], axis=1)

    def score_of(best: FloatArray, _: NDArray[np.int64]) -> FloatArray:
        return sigmoid(best) if layout.activation == "sigmoid" else best

    return of_dense(classes, groups, least, boxes_of, score_of)
