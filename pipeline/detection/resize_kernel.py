"""Numba kernel of the resize: every output pixel is a weighted sum of a few input pixels per axis.

Whole numbers: the weights down sum to 256, so that a row's sum fits 16 bits and is vectorised; those across to
65,536, so that all fits 32.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

#: what the weights of one output pixel sum to, down and across
ONE_DOWN, ONE_ACROSS = 256, 65_536
_HALF, _BITS = ONE_DOWN * ONE_ACROSS // 2, np.uint32(24)


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

    image (H, W, 3), out (h, w, 3), rows (h, m), columns (w, 2, 4 or 6) times three; weights of the same shapes, in
    1 / ONE_DOWN and 1 / ONE_ACROSS. The first axis is summed along whole rows. Unsigned indices spare a branch each.
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
            mix_six(line, out[y], columns, column_weights)


@numba.njit(cache=True, inline="always")
def mix_two(
    line: NDArray[np.uint16],
    out: NDArray[np.uint8],
    columns: NDArray[np.uintp],
    weights: NDArray[np.uint32],
) -> None:
    """out (w, 3): of each pixel two places of the line."""
    half = np.uint32(_HALF)
    for x in range(out.shape[0]):
        a, b = columns[x, 0], columns[x, 1]
        p, q = weights[x, 0], weights[x, 1]
        for c in range(3):
            k = np.uintp(c)
            out[x, c] = np.uint8(np.uint32(p * line[a + k] + q * line[b + k] + half) >> _BITS)


@numba.njit(cache=True, inline="always")
def mix_four(
    line: NDArray[np.uint16],
    out: NDArray[np.uint8],
    columns: NDArray[np.uintp],
    weights: NDArray[np.uint32],
) -> None:
    """out (w, 3): of each pixel four places of the line."""
    half = np.uint32(_HALF)
    for x in range(out.shape[0]):
        a, b, d, e = columns[x, 0], columns[x, 1], columns[x, 2], columns[x, 3]
        p, q, r, s = weights[x, 0], weights[x, 1], weights[x, 2], weights[x, 3]
        for c in range(3):
            k = np.uintp(c)
            total = p * line[a + k] + q * line[b + k] + r * line[d + k] + s * line[e + k] + half
            out[x, c] = np.uint8(np.uint32(total) >> _BITS)


@numba.njit(cache=True, inline="always")
def mix_six(
    line: NDArray[np.uint16],
    out: NDArray[np.uint8],
    columns: NDArray[np.uintp],
    weights: NDArray[np.uint32],
) -> None:
    """out (w, 3): of each pixel six places of the line."""
    half = np.uint32(_HALF)
    for x in range(out.shape[0]):
        a, b, d = columns[x, 0], columns[x, 1], columns[x, 2]
        e, f, g = columns[x, 3], columns[x, 4], columns[x, 5]
        p, q, r = weights[x, 0], weights[x, 1], weights[x, 2]
        s, t, u = weights[x, 3], weights[x, 4], weights[x, 5]
        for c in range(3):
            k = np.uintp(c)
            total = p * line[a + k] + q * line[b + k] + r * line[d + k] + half
            total += s * line[e + k] + t * line[f + k] + u * line[g + k]
            out[x, c] = np.uint8(np.uint32(total) >> _BITS)


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
