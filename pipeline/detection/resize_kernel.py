"""Numba kernels of the resize: every output pixel is a weighted sum of a few input pixels per axis."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray


@numba.njit(cache=True)
def halve(image: NDArray[np.uint8], out: NDArray[np.uint8]) -> None:
    """out (H, W, 3) = the rounded mean of the 2 x 2 blocks of image (2H, 2W, 3)."""
    height, width = out.shape[0], out.shape[1]
    for y in range(height):
        upper, lower = image[2 * y], image[2 * y + 1]
        for x in range(width):
            for c in range(3):
                total = (
                    np.int32(upper[2 * x, c])
                    + np.int32(upper[2 * x + 1, c])
                    + np.int32(lower[2 * x, c])
                    + np.int32(lower[2 * x + 1, c])
                )
                out[y, x, c] = np.uint8((total + 2) >> 2)


@numba.njit(cache=True, fastmath=True)
def resample(
    image: NDArray[np.uint8],
    out: NDArray[np.uint8],
    rows: NDArray[np.int64],
    row_weights: NDArray[np.float32],
    columns: NDArray[np.int64],
    column_weights: NDArray[np.float32],
) -> None:
    """out[y, x] = sum over i, j of row_weights[y, i] column_weights[x, j] image[rows[y] + i, columns[x] + j].

    The first axis is summed along whole rows, which vectorises.
    """
    width = image.shape[1]
    flat = image.reshape(image.shape[0], width * 3)
    line = np.empty(width * 3, np.float32)
    for y in range(out.shape[0]):
        line[:] = row_weights[y, 0] * flat[rows[y]]
        for i in range(1, row_weights.shape[1]):
            weight = row_weights[y, i]
            if weight > 0.0:
                source = flat[rows[y] + i]
                for k in range(width * 3):
                    line[k] += weight * np.float32(source[k])
        for x in range(out.shape[1]):
            red = green = blue = np.float32(0.5)
            for j in range(column_weights.shape[1]):
                weight = column_weights[x, j]
                if weight > 0.0:
                    k = 3 * (columns[x] + j)
                    red += weight * line[k]
                    green += weight * line[k + 1]
                    blue += weight * line[k + 2]
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = np.uint8(red), np.uint8(green), np.uint8(blue)
