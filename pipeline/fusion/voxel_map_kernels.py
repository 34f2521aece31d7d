"""The compiled update of the voxel map."""

from __future__ import annotations

import numba


@numba.njit(cache=True)
def add_clamped(log_odds, observations, rows, columns, delta, low, high):  # type: ignore[no-untyped-def]
    """Add delta (N,) to the cells, one after the other, each sum clamped to low..high."""
    for i in range(rows.size):
        r, c = rows[i], columns[i]
        log_odds[r, c] = min(max(log_odds[r, c] + delta[i], low), high)
        observations[r, c] += 1
