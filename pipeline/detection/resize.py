"""Pictures at another size, by the filter that a network was trained with."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.detection.resize_kernel import halve, resample
from pipeline.messages import FloatArray

Filter = Literal["area", "linear", "triangle"]


def resize(image: NDArray[np.uint8], width: int, height: int, method: Filter = "area") -> NDArray[np.uint8]:
    """The picture, uint8 (H, W, 3), at height x width; pixel corners map to pixel corners.

    area: the mean over each output pixel, linear when growing. linear: between the nearest pixel centres, so
    aliased when shrinking (OpenCV's). triangle: linear, but as wide as the scale when shrinking (Pillow's).
    """
    if image.shape[:2] == (height, width):
        return image
    image = np.ascontiguousarray(image)
    out = np.empty((height, width, 3), np.uint8)
    if method == "area" and image.shape[:2] == (2 * height, 2 * width):
        halve(image, out)
    else:
        rows, row_weights = _weights(image.shape[0], height, method)
        columns, column_weights = _weights(image.shape[1], width, method)
        resample(image, out, rows, row_weights, columns, column_weights)
    return out


@lru_cache(maxsize=64)
def _weights(size_in: int, size_out: int, method: Filter) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """For each output pixel of an axis: its first input pixel (n,), and the weights (n, taps) from there."""
    dense = _FILTERS[method](size_in, size_out)
    used = dense > 1e-9
    taps = int(used.sum(axis=1).max())
    first = np.minimum(used.argmax(axis=1), size_in - taps)
    weights = np.take_along_axis(dense, first[:, None] + np.arange(taps), axis=1)
    return first, (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)


def _area(size_in: int, size_out: int) -> FloatArray:
    """Weights (out, in): how much of the output pixel's span the input pixel covers."""
    if size_out > size_in:
        return _linear(size_in, size_out)
    edges = np.arange(size_out + 1)[:, None] * (size_in / size_out)
    pixel = np.arange(size_in)
    return np.clip(np.minimum(pixel + 1, edges[1:]) - np.maximum(pixel, edges[:-1]), 0.0, None)


def _linear(size_in: int, size_out: int) -> FloatArray:
    """Weights (out, in) of linear interpolation between pixel centres, constant beyond the last."""
    centre = (np.arange(size_out)[:, None] + 0.5) * (size_in / size_out)
    distance = np.abs(np.arange(size_in) + 0.5 - np.clip(centre, 0.5, size_in - 0.5))
    return np.clip(1.0 - distance, 0.0, None)


def _triangle(size_in: int, size_out: int) -> FloatArray:
    """Weights (out, in) that fall linearly over one output pixel, or one input pixel if that is wider."""
    scale = size_in / size_out
    centre = (np.arange(size_out)[:, None] + 0.5) * scale
    distance = np.abs(np.arange(size_in) + 0.5 - centre)
    return np.clip(1.0 - distance / max(scale, 1.0), 0.0, None)


_FILTERS: dict[Filter, Callable[[int, int], FloatArray]] = {
    "area": _area,
    "linear": _linear,
    "triangle": _triangle,
}
