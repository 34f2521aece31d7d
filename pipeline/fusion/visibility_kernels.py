"""The compiled horizon sweep: which surface cells a camera sees."""

from __future__ import annotations

import math

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def sweep(
    heights, position, first_azimuth, azimuth_step, azimuths, near, far, step, toward_camera, lens, stamps, corner, cells
):  # type: ignore[no-untyped-def]
    """Walk outward along each azimuth and keep what rises above the horizon so far and lies in the picture.

    heights: (rows, columns), NaN unknown. position: (3,) camera; x and y in cells from the grid's corner, z in metres.
    near, far, step: horizontal, cells. toward_camera: (3, 3), columns: camera-frame metres per cell east, per cell north and
    per metre up. lens: see in_picture. stamps: uint8 window, zero, whose cell (0, 0) is the grid's cell corner (2,);
    cells: int64 (>= stamps.size, 2), gets row and column of each seen cell once. Returns how many.
    """
    rows, columns = heights.shape
    found = 0
    for i in range(azimuths):
        azimuth = first_azimuth + i * azimuth_step
        east, north = math.sin(azimuth), math.cos(azimuth)
        start, end = _clip(position[0], east, columns, near, far)
        start, end = _clip(position[1], north, rows, start, end)
        ax = east * toward_camera[0, 0] + north * toward_camera[0, 1]
        ay = east * toward_camera[1, 0] + north * toward_camera[1, 1]
        az = east * toward_camera[2, 0] + north * toward_camera[2, 1]
        horizon = -np.inf
        k = math.ceil(start / step - 0.5)
        t = (k + 0.5) * step
        while t < end:
            x, y = position[0] + t * east, position[1] + t * north
            up = surface(heights, x, y) - position[2]
            slope = up / t
            if slope > horizon:
                horizon = slope
                r = min(int(y), rows - 1)
                c = min(int(x), columns - 1)
                if stamps[r - corner[0], c - corner[1]] == 0:
                    px = t * ax + up * toward_camera[0, 2]
                    py = t * ay + up * toward_camera[1, 2]
                    pz = t * az + up * toward_camera[2, 2]
                    if in_picture(px, py, pz, lens):
                        stamps[r - corner[0], c - corner[1]] = 1
                        cells[found, 0] = r
                        cells[found, 1] = c
                        found += 1
            k += 1
            t = (k + 0.5) * step
    return found


@numba.njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def observe(heights, position, cell_m, toward_camera, lens, boxes, max_distance, cells, distances):  # type: ignore[no-untyped-def]
    """Keep the cells whose centre is within max_distance (metres) and in no box (M, 4); in place, order kept.

    distances: float64, gets the distance of each kept cell's centre, metres. Returns how many.
    """
    kept = 0
    for i in range(cells.shape[0]):
        r, c = cells[i, 0], cells[i, 1]
        x, y = c + 0.5 - position[0], r + 0.5 - position[1]
        up = heights[r, c] - position[2]
        distance = math.sqrt((x * x + y * y) * cell_m * cell_m + up * up)
        if distance > max_distance:
            continue
        if boxes.shape[0] > 0:
            px = x * toward_camera[0, 0] + y * toward_camera[0, 1] + up * toward_camera[0, 2]
            py = x * toward_camera[1, 0] + y * toward_camera[1, 1] + up * toward_camera[1, 2]
            pz = x * toward_camera[2, 0] + y * toward_camera[2, 1] + up * toward_camera[2, 2]
            if _in_a_box(px, py, pz, lens, boxes):
                continue
        cells[kept, 0] = r
        cells[kept, 1] = c
        distances[kept] = distance
        kept += 1
    return kept


@numba.njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def surface(heights, x, y):  # type: ignore[no-untyped-def]
    """Terrain.height inside the grid, x and y in cells from its corner: bilinear between centres, level in the outer half cell."""
    rows, columns = heights.shape
    x, y = min(max(x - 0.5, 0.0), columns - 1.0), min(max(y - 0.5, 0.0), rows - 1.0)
    c, r = int(x), int(y)
    c1, r1 = min(c + 1, columns - 1), min(r + 1, rows - 1)
    fx, fy = x - c, y - r
    low = heights[r, c] + (heights[r, c1] - heights[r, c]) * fx
    high = heights[r1, c] + (heights[r1, c1] - heights[r1, c]) * fx
    return low + (high - low) * fy


@numba.njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def in_picture(x, y, z, lens):  # type: ignore[no-untyped-def]
    """Whether a camera-frame point lies in the picture. lens: (12,) fx, fy, cx, cy, width, height, k1, k2, p1, p2, k3, r2_max."""
    if z <= 1e-9:
        return False
    u, v = _pixel(x / z, y / z, lens)
    return 0.0 <= u < lens[4] and 0.0 <= v < lens[5]


@numba.njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _in_a_box(x, y, z, lens, boxes):  # type: ignore[no-untyped-def]
    if z <= 1e-9:
        return False
    u, v = _pixel(x / z, y / z, lens)
    for i in range(boxes.shape[0]):
        if boxes[i, 0] <= u <= boxes[i, 2] and boxes[i, 1] <= v <= boxes[i, 3]:
            return True
    return False


@numba.njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _pixel(x, y, lens):  # type: ignore[no-untyped-def]
    r2 = x * x + y * y
    if r2 > lens[11]:  # beyond the picture's corners the distortion polynomial may fold back into the picture
        return np.nan, np.nan
    radial = 1.0 + r2 * (lens[6] + r2 * (lens[7] + r2 * lens[10]))
    u = x * radial + 2.0 * lens[8] * x * y + lens[9] * (r2 + 2.0 * x * x)
    v = y * radial + lens[8] * (r2 + 2.0 * y * y) + 2.0 * lens[9] * x * y
    return u * lens[0] + lens[2], v * lens[1] + lens[3]


@numba.njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _clip(position, direction, cells, start, end):  # type: ignore[no-untyped-def]
    """The part of start..end on which position + t * direction lies in 0..cells."""
    if abs(direction) < 1e-12:
        return (start, end) if 0.0 <= position < cells else (1.0, 0.0)
    a, b = -position / direction, (cells - position) / direction
    return max(start, min(a, b)), min(end, max(a, b))
