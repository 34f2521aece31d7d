"""The most rows of a table whose times increase."""

from __future__ import annotations

import bisect

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import FloatArray


def longest_increasing(values: FloatArray) -> NDArray[np.int64]:
    """Numbers, in order, of the most values that increase strictly; NaN are passed over.

    One wild time costs its own row, not all those after it. Patience sorting (Fredman 1975), N log N.
    """
    tops: list[float] = []
    rows: list[int] = []
    before = np.full(len(values), -1, np.int64)
    for row in np.flatnonzero(np.isfinite(values)).tolist():
        value = float(values[row])
        pile = bisect.bisect_left(tops, value)
        before[row] = rows[pile - 1] if pile else -1
        if pile == len(tops):
            tops.append(value)
            rows.append(row)
        elif value < tops[pile]:
            # the first of equal times stays: it is the one that was not a repetition
            tops[pile], rows[pile] = value, row
    chain = []
    row = rows[-1] if rows else -1
    while row >= 0:
        chain.append(row)
        row = int(before[row])
    return np.array(chain[::-1], np.int64)
