"""Pictures at another size, by the filter that a network was trained with."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.detection.resize_kernel import ONE, resample
from pipeline.messages import FloatArray

Filter = Literal["area", "linear", "triangle"]
#: input pixels per axis for an output pixel; a filter that is wider is sampled at so many places, evenly. More
#: cost time in proportion and change no network's accuracy (tests/benchmarks/bench_detection.py)
MOST_TAPS = 3


def resize(image: NDArray[np.uint8], width: int, height: int, method: Filter = "area") -> NDArray[np.uint8]:
    """The picture, uint8 (H, W, 3), at height x width; pixel corners map to pixel corners.

    area: the mean over each output pixel, linear when growing. linear: between the nearest pixel centres, so
    aliased when shrinking (OpenCV's). triangle: linear, but as wide as the scale when shrinking (Pillow's).
    Right to about one grey value; where more than MOST_TAPS pixels would be averaged, some stand for all.
    """
    if image.shape[:2] == (height, width):
        return image
    out = np.empty((height, width, 3), np.uint8)
    rows, row_weights = _taps(image.shape[0], height, method)
    resample(np.ascontiguousarray(image), out, rows, row_weights, *_columns(image.shape[1], width, method))
    return out


@lru_cache(maxsize=64)
def _columns(size_in: int, size_out: int, method: Filter) -> tuple[NDArray[np.uintp], NDArray[np.uint32]]:
    """As _taps, places times three, two or three of them."""
    places, weights = _taps(size_in, size_out, method)
    lacking = (2 if places.shape[1] <= 2 else 3) - places.shape[1]
    places = np.concatenate([places, places[:, :1].repeat(lacking, axis=1)], axis=1)
    weights = np.concatenate([weights, np.zeros((len(weights), lacking), np.uint16)], axis=1)
    return np.ascontiguousarray(places * np.uintp(3)), np.ascontiguousarray(weights, np.uint32)


@lru_cache(maxsize=64)
def _taps(size_in: int, size_out: int, method: Filter) -> tuple[NDArray[np.uintp], NDArray[np.uint16]]:
    """For each output pixel of an axis: input pixels (n, taps), and their weights (n, taps), in 1 / ONE."""
    dense = _FILTERS[method](size_in, size_out)
    used = dense > 1e-9
    count, first = used.sum(axis=1), used.argmax(axis=1)
    taps = min(int(count.max()), MOST_TAPS)
    # places in the span of each output pixel: all of it, or evenly spread ones
    spread = (np.arange(taps) + 0.5) / taps * count[:, None]
    every = np.arange(taps)[None] + 0.0
    places = first[:, None] + np.where(count[:, None] <= taps, every, np.floor(spread)).astype(np.int64)
    places = np.minimum(places, size_in - 1)
    weights = np.take_along_axis(dense, places, axis=1)
    weights = np.where((count[:, None] <= taps) & (np.arange(taps) >= count[:, None]), 0.0, weights)
    return places.astype(np.uintp), _whole(weights / weights.sum(axis=1, keepdims=True))


def _whole(weights: FloatArray) -> NDArray[np.uint16]:
    """Weights (n, taps) in 1 / ONE that sum to it: what rounding lacks goes to those that it cut most."""
    exact = weights * ONE
    whole = np.floor(exact)
    lacking = (ONE - whole.sum(axis=1)).astype(int)
    order = np.argsort(np.argsort(-(exact - whole), axis=1, kind="stable"), axis=1)
    return (whole + (order < lacking[:, None])).astype(np.uint16)


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
