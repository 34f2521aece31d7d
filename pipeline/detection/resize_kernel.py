"""Numba kernel of the resize: every output pixel is a weighted sum of a few input pixels per axis.

Whole numbers: the weights of an axis sum to 256, so that a row's sum fits 16 bits and is vectorised.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

#: what the weights of one output pixel sum to, along each axis
ONE = 256


@numba.njit(cache=True)
def resample(
    image: NDArray[np.uint8],
    out: NDArray[np.uint8],
    rows: NDArray[np.uintp],
    row_weights: NDArray[np.uint16],
    columns: NDArray[np.uintp],
    column_weights: NDArray[np.uint32],
) -> None:
    """out[y, x] = sum over i, j of row_weights[y, i] column_weights[x, j] image[rows[y, i], columns[x, j]].

    image (H, W, 3), out (h, w, 3), rows (h, m), columns (w, 2, 4, 6 ..) times three; weights of the same shapes, in
    1 / ONE. The first axis is summed along whole rows. Unsigned indices spare a branch each.
    """
    width = image.shape[1] * 3
    flat = image.reshape(image.shape[0], width)
    line = np.empty(width, np.uint16)
    taps = columns.shape[1]
    for y in range(out.shape[0]):
        sum_rows(flat, rows[y], row_weights[y], line)
        if taps == 2:
            mix_two(line, out[y], columns, column_weights)
        elif taps == 4:
            mix_four(line, out[y], columns, column_weights)
        else:
            mix_pairs(line, out[y], columns, column_weights)


@numba.njit(cache=True, inline="always")
def mix_two(
    line: NDArray[np.uint16],
    out: NDArray[np.uint8],
    columns: NDArray[np.uintp],
    weights: NDArray[np.uint32],
) -> None:
    """out (w, 3): of each pixel two places of the line."""
    half = np.uint32(ONE * ONE // 2)
    for x in range(out.shape[0]):
        a, b = columns[x, 0], columns[x, 1]
        p, q = weights[x, 0], weights[x, 1]
        for c in range(3):
            k = np.uintp(c)
            out[x, c] = np.uint8(np.uint32(p * line[a + k] + q * line[b + k] + half) >> np.uint32(16))


@numba.njit(cache=True, inline="always")
def mix_four(
    line: NDArray[np.uint16],
    out: NDArray[np.uint8],
    columns: NDArray[np.uintp],
    weights: NDArray[np.uint32],
) -> None:
    """out (w, 3): of each pixel four places of the line."""
    half = np.uint32(ONE * ONE // 2)
    for x in range(out.shape[0]):
        a, b, d, e = columns[x, 0], columns[x, 1], columns[x, 2], columns[x, 3]
        p, q, r, s = weights[x, 0], weights[x, 1], weights[x, 2], weights[x, 3]
        for c in range(3):
            k = np.uintp(c)
            total = p * line[a + k] + q * line[b + k] + r * line[d + k] + s * line[e + k] + half
            out[x, c] = np.uint8(np.uint32(total) >> np.uint32(16))


@numba.njit(cache=True, inline="always")
def mix_pairs(
    line: NDArray[np.uint16],
    out: NDArray[np.uint8],
    columns: NDArray[np.uintp],
    weights: NDArray[np.uint32],
) -> None:
    """out (w, 3): of each pixel an even number of places of the line."""
    one, two = np.uintp(1), np.uintp(2)
    for x in range(out.shape[0]):
        red = green = blue = np.uint32(ONE * ONE // 2)
        for j in range(0, columns.shape[1], 2):
            a, b = columns[x, j], columns[x, j + 1]
            p, q = weights[x, j], weights[x, j + 1]
            red = np.uint32(red + p * line[a] + q * line[b])
            green = np.uint32(green + p * line[a + one] + q * line[b + one])
            blue = np.uint32(blue + p * line[a + two] + q * line[b + two])
        out[x, 0], out[x, 1], out[x, 2] = np.uint8(red >> 16), np.uint8(green >> 16), np.uint8(blue >> 16)


@numba.njit(cache=True, inline="always")
def sum_rows(
    flat: NDArray[np.uint8], rows: NDArray[np.uintp], weights: NDArray[np.uint16], line: NDArray[np.uint16]
) -> None:
    """line (W,) = sum over i of weights[i] flat[rows[i]]; two rows at a time."""
    first, second = flat[rows[0]], flat[rows[min(1, len(rows) - 1)]]
    a, b = weights[0], weights[1] if len(rows) > 1 else np.uint16(0)
    for k in range(len(line)):
        line[k] = np.uint16(a * first[k] + b * second[k])
    for i in range(2, len(rows), 2):
        first, second = flat[rows[i]], flat[rows[min(i + 1, len(rows) - 1)]]
        a, b = weights[i], weights[i + 1] if i + 1 < len(rows) else np.uint16(0)
        for k in range(len(line)):
            line[k] = np.uint16(line[k] + a * first[k] + b * second[k])
