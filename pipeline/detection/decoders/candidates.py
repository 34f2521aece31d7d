"""Candidates of one picture, of the classes that are asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.config.layout import BoxForm
from pipeline.messages import FloatArray

#: of each class that is asked for: the network's classes that are it; None: any class, as class 0
Groups = tuple[tuple[int, ...], ...] | None
Outputs = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """boxes (N, 4) xyxy in pixels of the input, scores (N,), group (N,) int64, place (N,) in the output."""

    boxes: FloatArray
    scores: FloatArray
    group: NDArray[np.int64]
    place: NDArray[np.int64]


def of_dense(
    classes: NDArray[Any],
    groups: Groups,
    least: float,
    boxes_of: Callable[[NDArray[np.int64]], FloatArray],
    score_of: Callable[[FloatArray, NDArray[np.int64]], FloatArray],
) -> Candidates:
    """Candidates of a network that says a score of every class at every place.

    classes (K, N), rising with the score. score_of: what such a value is worth at places. Only candidates of
    at least ``least`` (or NaN) are decoded further.
    """
    every = np.arange(classes.shape[1])
    parts = []
    for number, group in enumerate([tuple(range(len(classes)))] if groups is None else groups):
        value = classes[group[0]] if len(group) == 1 else classes[list(group)].max(axis=0)
        scores = score_of(np.asarray(value, np.float64), every)
        likely = np.flatnonzero(~(scores < least))
        parts.append((likely, scores[likely], np.full(likely.size, number)))
    place, scores, group_of = (np.concatenate(part) for part in zip(*parts, strict=True))
    if not place.size:
        return Candidates(np.zeros((0, 4)), scores, group_of, place)
    return Candidates(boxes_of(place), scores, group_of, place)


def of_labelled(
    boxes: FloatArray, scores: FloatArray, labels: NDArray[Any], groups: Groups, least: float
) -> Candidates:
    """Candidates of a network that says one class of each."""
    group = np.zeros(len(scores), np.int64)
    if groups is not None:
        group[:] = -1
        for number, members in enumerate(groups):
            group[np.isin(labels, members)] = number
    kept = np.flatnonzero((group >= 0) & ~(scores < least))
    return Candidates(boxes[kept], scores[kept], group[kept], kept)


def corners(values: NDArray[Any], form: BoxForm) -> FloatArray:
    """Boxes (N, 4) xyxy of boxes (N, 4) in another form."""
    boxes = np.asarray(values, np.float64)
    if form == "xyxy":
        return boxes
    if form == "yxyx":
        return boxes[:, [1, 0, 3, 2]]
    start, size = boxes[:, :2], boxes[:, 2:]
    if form == "cxcywh":
        start = start - size / 2
    return np.concatenate([start, start + size], axis=1)


def sigmoid(x: FloatArray) -> FloatArray:
    """1 / (1 + exp(-x))."""
    with np.errstate(over="ignore"):
        return 1.0 / (1.0 + np.exp(-x))


@lru_cache(maxsize=32)
def grid(width: int, height: int, strides: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """Of all cells of the strides, row by row: column and row (N, 2), and stride (N, 1)."""
    cells, sizes = [], []
    for stride in strides:
        y, x = np.mgrid[: -(-height // stride), : -(-width // stride)]
        cells.append(np.stack([x.ravel(), y.ravel()], axis=1).astype(float))
        sizes.append(np.full((x.size, 1), float(stride)))
    found = np.concatenate(cells), np.concatenate(sizes)
    for array in found:
        array.setflags(write=False)
    return found
