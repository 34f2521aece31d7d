"""The compiled updates of the voxel map."""

from __future__ import annotations

import math

import numba
import numpy as np


@numba.njit(cache=True)
def add_clamped(cells, flat, delta, low, high):  # type: ignore[no-untyped-def]
    """Add delta (N,) to the voxels at flat (N,), one after the other, each sum clamped to low..high."""
    for i in range(flat.size):
        cell = cells[flat[i]]
        cell.log_odds = min(max(cell.log_odds + delta[i], low), high)
        cell.observations += 1


@numba.njit(cache=True, error_model="numpy")
def observe(
    cells, flat, distances, raised, strength, pod, max_distance, resolution, time_ns, gap_ns, low, high
):  # type: ignore[no-untyped-def]
    """Lower the voxels at flat (N,), but not those raised (M,), and note how well all of them were seen.

    distances: (N,) from the camera, metres. strength: p_det^rel * p_negative^max. pod: of one frame from no
    distance. max_distance: metres, where both have fallen to 0; farther voxels are left alone. resolution:
    pixels per person times metres. low, high: limits of the log-odds.
    """
    for i in range(flat.size):
        distance = distances[i]
        if distance > max_distance:
            continue
        cell = cells[flat[i]]
        factor = 1.0 - distance / max_distance
        if not _among(flat[i], raised):
            p = max(0.5 - factor * strength, 1e-9)
            cell.log_odds = min(max(cell.log_odds + math.log(p / (1.0 - p)), low), high)
            cell.observations += 1
        if cell.looks == 0 or time_ns - cell.last_seen_ns > gap_ns:
            cell.pod_before = 1.0 - (1.0 - cell.pod_before) * (1.0 - cell.pod_look)
            cell.pod_look = 0.0
            cell.looks += 1
        cell.pod_look = max(cell.pod_look, np.float32(pod * factor))
        cell.resolution_px = max(cell.resolution_px, np.float32(resolution / distance))
        cell.last_seen_ns = max(cell.last_seen_ns, time_ns)


@numba.njit(cache=True)
def _among(value, values):  # type: ignore[no-untyped-def]
    for i in range(values.size):
        if values[i] == value:
            return True
    return False
