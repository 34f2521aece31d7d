"""The compiled updates of the voxel map."""

from __future__ import annotations

import math

import numba
import numpy as np

from pipeline.fusion.look_kernels import note_look
from pipeline.fusion.tiles import TILE, TILE_BITS


@numba.njit(cache=True)
def add_clamped(cells, flat, delta, low, high):  # type: ignore[no-untyped-def]
    """Add delta (N,) to the voxels at flat (N,), one after the other, each sum clamped to low..high."""
    for i in range(flat.size):
        cell = cells[flat[i]]
        cell.log_odds = min(max(cell.log_odds + delta[i], low), high)
        cell.observations += 1


@numba.njit(cache=True, error_model="numpy")
def observe(  # type: ignore[no-untyped-def]
    cells,
    owned,
    touched,
    seen,
    distances,
    raised,
    raised_distances,
    wide,
    strength,
    found,
    reach,
    time,
    limits,
):
    """Lower the seen voxels (2, N), raise those of the wide looks, and note how well all of them were seen.

    owned, touched: (tile rows, tile columns); other voxels are left alone. distances, raised_distances: (N,),
    (M,) from the camera, metres. raised: (2, M), the cells of the looks' points. wide: of the looks that have a
    width, as in ``footprint``: windows, starts, raised, shielded, and the odds e^R (W,) of their updates; where
    there is none, the cells of raised have been raised before, and are not lowered. strength: p_det^rel *
    p_negative^max, POD of a frame from no distance, and the share of the frame's evidence that counts. found: (K,),
    the probability that somebody is found, at distances from 0 to where nobody is; then the first of strength is
    p_negative^max alone, and POD is what is found; empty: both fall linearly with the distance, as the paper's. reach:
    metres, where both have fallen to 0 (farther voxels are not lowered), and pixels per person times metres.
    time: as ``note_look`` takes it. limits: of the log-odds.
    """
    negative, pod, share = strength
    max_distance, resolution = reach
    low, high = limits
    per_m, per_bin = 1.0 / max_distance, (found.size - 1) / max_distance
    known = found.size > 0
    kept = (1.0 - found) ** share
    width = wide[0].shape[0]
    done = np.zeros(wide[2].size, dtype=np.bool_)
    for i in range(seen.shape[1]):
        r, c, distance = seen[0, i], seen[1, i], distances[i]
        if distance > max_distance or not owned[r >> TILE_BITS, c >> TILE_BITS]:
            continue
        touched[r >> TILE_BITS, c >> TILE_BITS] = True
        cell = cells[_flat(r, c, touched.shape[1])]
        step = int(distance * per_bin + 0.5) if known else 0
        factor = found[step] if known else 1.0 - distance * per_m
        if width or not _among(r, c, raised):
            less = min(factor * negative, 0.5 - 1e-9)
            odds = (0.5 - less) / (0.5 + less)
            if width:
                odds = _odds_of_wide(r, c, odds, wide, done)
            cell.log_odds = min(max(cell.log_odds + share * math.log(odds), low), high)
            cell.observations += 1
        note_look(cell, pod * factor, kept[step] if known else -1.0, resolution / distance, time)
    if width:
        _raise_unseen(cells, owned, touched, wide, done, share, limits)
    for i in range(raised.shape[1]):  # they may lie behind their box, but they were seen
        if owned[raised[0, i] >> TILE_BITS, raised[1, i] >> TILE_BITS]:
            cell = cells[_flat(raised[0, i], raised[1, i], touched.shape[1])]
            factor = max(1.0 - raised_distances[i] / max_distance, 0.0)
            step = int(min(raised_distances[i], max_distance) * per_bin + 0.5) if known else 0
            note_look(
                cell, pod * factor, kept[step] if known else -1.0, resolution / raised_distances[i], time
            )


@numba.njit(cache=True, error_model="numpy")
def _odds_of_wide(row, column, missed, wide, done):  # type: ignore[no-untyped-def]
    """The odds of a cell by the look that says most of it. missed: by none of them; noted in done."""
    windows, starts, raised, shielded, odds = wide
    most, shield = 0.0, 0.0
    for j in range(windows.shape[0]):
        r, c = row - windows[j, 0], column - windows[j, 1]
        if 0 <= r < windows[j, 2] and 0 <= c < windows[j, 3]:
            k = starts[j] + r * windows[j, 3] + c
            done[k] = True
            shield = max(shield, shielded[k])
            kept = shielded[k] + (1.0 - shielded[k]) * missed
            most = max(most, raised[k] * odds[j] + (1.0 - raised[k]) * kept)
    return max(most, shield + (1.0 - shield) * missed)


@numba.njit(cache=True, error_model="numpy")
def _raise_unseen(cells, owned, touched, wide, done, share, limits):  # type: ignore[no-untyped-def]
    """Raise the cells of the wide looks that are behind a box, or that the frame does not speak for."""
    windows, starts, raised = wide[0], wide[1], wide[2]
    low, high = limits
    for j in range(windows.shape[0]):
        for k in range(starts[j], starts[j + 1]):
            if done[k] or raised[k] == 0.0:
                continue
            r = windows[j, 0] + (k - starts[j]) // windows[j, 3]
            c = windows[j, 1] + (k - starts[j]) % windows[j, 3]
            odds = _odds_of_wide(r, c, 1.0, wide, done)
            if not owned[r >> TILE_BITS, c >> TILE_BITS]:
                continue
            touched[r >> TILE_BITS, c >> TILE_BITS] = True
            cell = cells[_flat(r, c, touched.shape[1])]
            cell.log_odds = min(max(cell.log_odds + share * math.log(odds), low), high)
            cell.observations += 1


@numba.njit(cache=True)
def _flat(row, column, tile_columns):  # type: ignore[no-untyped-def]
    """Where a cell lies in the array of all cells, see Tiles."""
    tile = np.int64(row >> TILE_BITS) * tile_columns + (column >> TILE_BITS)
    return (tile << 2 * TILE_BITS) + ((row & (TILE - 1)) << TILE_BITS) + (column & (TILE - 1))


@numba.njit(cache=True)
def _among(row, column, cells):  # type: ignore[no-untyped-def]
    found = False
    for i in range(cells.shape[1]):
        found |= cells[0, i] == row and cells[1, i] == column
    return found
