"""Pictures at another size, by the filter that a network was trained with."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.detection.resize_kernel import ONE_ACROSS, ONE_DOWN, resample
from pipeline.messages import FloatArray

Filter = Literal["area", "linear", "triangle"]
#: input pixels for an output pixel, down and across; of a filter that is wider some stand for all. Rows are
#: summed in vectors and cost little
MOST_ROWS, MOST_COLUMNS = 6, 6
#: weighted pixels of a whole picture; a large output pixel by pixel gets fewer, but four
_MOST_IN_ALL = 400_000


def resize(image: NDArray[np.uint8], width: int, height: int, method: Filter = "area") -> NDArray[np.uint8]:
    """The picture, uint8 (H, W, 3), at height x width; pixel corners map to pixel corners.

    area: the mean over each output pixel, linear when growing. linear: between the nearest pixel centres, so
    aliased when shrinking (OpenCV's). triangle: linear, but as wide as the scale when shrinking (Pillow's).
    Right to about one grey value; where more than some pixels would be averaged, evenly spread ones stand for all.
    """
    if image.shape[:2] == (height, width):
        return image
    out = np.empty((height, width, 3), np.uint8)
    most = int(np.clip(_MOST_IN_ALL // (width * height), 4, MOST_COLUMNS))
    rows, row_weights = _rows(image.shape[0], height, method)
    resample(
        np.ascontiguousarray(image), out, rows, row_weights, *_columns(image.shape[1], width, method, most)
    )
    return out


@lru_cache(maxsize=64)
def _rows(size_in: int, size_out: int, method: Filter) -> tuple[NDArray[np.uintp], NDArray[np.uint16]]:
    """As _taps, weights in 1 / ONE_DOWN."""
    places, weights = _taps(size_in, size_out, method, MOST_ROWS)
    return places, _whole(weights, ONE_DOWN).astype(np.uint16)


@lru_cache(maxsize=64)
def _columns(
    size_in: int, size_out: int, method: Filter, most: int
) -> tuple[NDArray[np.uintp], NDArray[np.uint32]]:
    """As _taps, places times three, weights in 1 / ONE_ACROSS; two, four or six of them."""
    places, weights = _taps(size_in, size_out, method, most)
    lacking = next(k for k in (2, 4, 6) if k >= places.shape[1]) - places.shape[1]
    places = np.concatenate([places, places[:, :1].repeat(lacking, axis=1)], axis=1)
    weights = np.concatenate([weights, np.zeros((len(weights), lacking))], axis=1)
    return np.ascontiguousarray(places * np.uintp(3)), np.ascontiguousarray(
        _whole(weights, ONE_ACROSS), np.uint32
    )


def _taps(size_in: int, size_out: int, method: Filter, most: int) -> tuple[NDArray[np.uintp], FloatArray]:
    """For each output pixel of an axis: input pixels (n, taps), and their weights (n, taps), which sum to 1.

    Where one more than the most would count, the lightest is left out; of more, evenly spread ones stay.
    """
    dense = _FILTERS[method](size_in, size_out)
    used = dense > 1e-9
    count = used.sum(axis=1)
    taps = min(int(count.max()), most)
    heaviest = np.sort(np.argsort(-dense, axis=1, kind="stable")[:, :taps], axis=1)
    spread = used.argmax(axis=1)[:, None] + np.floor((np.arange(taps) + 0.5) / taps * count[:, None])
    places = np.where((count <= taps + 1)[:, None], heaviest, spread.astype(np.int64))
    weights = np.take_along_axis(dense, places, axis=1)
    return places.astype(np.uintp), weights / weights.sum(axis=1, keepdims=True)


def _whole(weights: FloatArray, one: int) -> NDArray[np.int64]:
    """Weights (n, taps) in 1 / one that sum to it: what rounding lacks goes to those that it cut most."""
    exact = weights * one
    whole = np.floor(exact)
    lacking = (one - whole.sum(axis=1)).astype(int)
    order = np.argsort(np.argsort(-(exact - whole), axis=1, kind="stable"), axis=1)
    return np.asarray(whole + (order < lacking[:, None]), np.int64)


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
