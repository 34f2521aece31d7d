"""The compiled horizon sweep: which surface cells a camera sees."""

from __future__ import annotations

import math

import numba
import numpy as np


@numba.njit(cache=True, error_model="numpy")
def sweep(heights, position, outline, azimuths, far, drop, stamps, corner, cells):  # type: ignore[no-untyped-def]
    """Walk outward along each azimuth and keep what rises above the horizon so far and lies in the picture.

    A ray looks at the surface where it crosses a line of cell centres: there its ridges are.

    heights: (rows, columns), NaN unknown. position: (3,) camera; x and y in cells from the grid's corner, z
    in metres. outline: (N, 3) directions around the picture, metres per cell of horizontal way. azimuths:
    (M,) radians from north. far: horizontal reach, cells. drop: metres from the camera down to the highest
    cell, 0 if the camera is lower. stamps: uint8 window, zero, whose cell (0, 0) is the grid's cell corner
    (2,); cells: int64 (2, stamps.size), gets row and column of each seen cell once. Returns how many.
    """
    rows, columns = heights.shape
    found = 0
    for i in range(azimuths.size):
        east, north = math.sin(azimuths[i]), math.cos(azimuths[i])
        horizon, top = slopes(outline, east, north)
        start = -drop / horizon if horizon < 0.0 else 0.0  # nearer, the picture is above the highest cell
        start, end = _clip(position[0], east, columns, start, far)
        start, end = _clip(position[1], north, rows, start, end)
        c, c_step, t_column = _first_line(position[0], east, start)
        r, r_step, t_row = _first_line(position[1], north, start)
        t_before, slope_before = np.nan, np.nan
        while horizon < top:
            t = min(t_column, t_row)
            if t >= end:
                break
            if t_column <= t_row:
                height = between(heights[:, c], position[1] + t * north)
                c += c_step
                t_column = (c + 0.5 - position[0]) / east
            else:
                height = between(heights[r], position[0] + t * east)
                r += r_step
                t_row = (r + 0.5 - position[1]) / north
            slope = (height - position[2]) / t
            if slope > horizon:
                if slope_before < horizon:  # comes into sight on the way here
                    t_rise = _at(horizon, t_before, slope_before, t, slope)
                    found = _stamp(position, east, north, t_rise, rows, columns, stamps, corner, cells, found)
                if slope > top and slope_before < top:  # leaves the picture on the way here
                    t_leave = _at(top, t_before, slope_before, t, slope)
                    found = _stamp(
                        position, east, north, t_leave, rows, columns, stamps, corner, cells, found
                    )
                elif slope <= top:
                    found = _stamp(position, east, north, t, rows, columns, stamps, corner, cells, found)
                horizon = slope
            t_before, slope_before = t, slope
    return found


@numba.njit(cache=True, error_model="numpy")
def _first_line(position, direction, start):  # type: ignore[no-untyped-def]
    """The first line of centres from start on: its number, the step to the next one, and the way to it."""
    if abs(direction) < 1e-12:
        return 0, 0, np.inf
    step = 1 if direction > 0.0 else -1
    line = step * math.ceil(step * (position + start * direction - 0.5))
    return line, step, (line + 0.5 - position) / direction


@numba.njit(cache=True, error_model="numpy")
def _at(slope, t_before, slope_before, t_after, slope_after):  # type: ignore[no-untyped-def]
    """Where between two points of a ray the surface has this slope."""
    return t_before + (slope - slope_before) / (slope_after - slope_before) * (t_after - t_before)


@numba.njit(cache=True, error_model="numpy")
def _stamp(position, east, north, t, rows, columns, stamps, corner, cells, found):  # type: ignore[no-untyped-def]
    """Note the cell at t along the ray unless it is noted already; returns how many are."""
    r = min(int(position[1] + t * north), rows - 1)
    c = min(int(position[0] + t * east), columns - 1)
    if stamps[r - corner[0], c - corner[1]] == 0:
        stamps[r - corner[0], c - corner[1]] = 1
        cells[0, found], cells[1, found] = r, c
        found += 1
    return found


@numba.njit(cache=True, error_model="numpy")
def slopes(outline, east, north):  # type: ignore[no-untyped-def]
    """Least and greatest slope (up over away) at which the picture is cut by the half-plane of one azimuth.

    outline: (N, 3) directions around the picture, in order. east, north: unit azimuth. Infinite where the
    picture holds the pole that the half-plane turns about; (inf, -inf) if the half-plane misses the picture.
    """
    low, high = np.inf, -np.inf
    up_behind, down_behind = False, False
    n = outline.shape[0]
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        a = outline[i, 0] * north - outline[i, 1] * east
        b = outline[j, 0] * north - outline[j, 1] * east
        if (a < 0.0) == (b < 0.0):
            continue
        share = a / (a - b)
        ahead_a = outline[i, 0] * east + outline[i, 1] * north
        ahead_b = outline[j, 0] * east + outline[j, 1] * north
        ahead = ahead_a + share * (ahead_b - ahead_a)
        up = outline[i, 2] + share * (outline[j, 2] - outline[i, 2])
        if ahead > 0.0:
            low, high = min(low, up / ahead), max(high, up / ahead)
        elif up > 0.0:
            up_behind = True
        else:
            down_behind = True
    if low <= high and down_behind:
        low = -np.inf
    if low <= high and up_behind:
        high = np.inf
    return low, high


@numba.njit(cache=True, error_model="numpy")
def observe(heights, position, cell_m, toward_camera, lens, boxes, max_distance, cells, distances):  # type: ignore[no-untyped-def]
    """Keep the cells whose centre is within max_distance (metres) and in no box (M, 4); in place, order kept.

    toward_camera: (3, 3), columns: camera-frame metres per cell east, per cell north and per metre up. lens:
    (9,) fx, fy, cx, cy, k1, k2, p1, p2, k3. distances: float64, gets the distance of each kept cell's centre,
    metres. Returns how many.
    """
    kept = 0
    for i in range(distances.size):
        r, c = cells[0, i], cells[1, i]
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
        cells[0, kept], cells[1, kept] = r, c
        distances[kept] = distance
        kept += 1
    return kept


@numba.njit(cache=True, error_model="numpy")
def between(heights, x):  # type: ignore[no-untyped-def]
    """Height on a line of centres (N,) at x, cells from the grid's edge; level in the outer half cells."""
    last = heights.size - 1
    x = min(max(x - 0.5, 0.0), float(last))
    i = int(x)
    return heights[i] + (heights[min(i + 1, last)] - heights[i]) * (x - i)


@numba.njit(cache=True, error_model="numpy")
def _in_a_box(x, y, z, lens, boxes):  # type: ignore[no-untyped-def]
    if z <= 1e-9:
        return False
    u, v = _pixel(x / z, y / z, lens)
    for i in range(boxes.shape[0]):
        if boxes[i, 0] <= u <= boxes[i, 2] and boxes[i, 1] <= v <= boxes[i, 3]:
            return True
    return False


@numba.njit(cache=True, error_model="numpy")
def _pixel(x, y, lens):  # type: ignore[no-untyped-def]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]))
    u = x * radial + 2.0 * lens[6] * x * y + lens[7] * (r2 + 2.0 * x * x)
    v = y * radial + lens[6] * (r2 + 2.0 * y * y) + 2.0 * lens[7] * x * y
    return u * lens[0] + lens[2], v * lens[1] + lens[3]


@numba.njit(cache=True, error_model="numpy")
def _clip(position, direction, cells, start, end):  # type: ignore[no-untyped-def]
    """The part of start..end on which position + t * direction lies in 0..cells."""
    if abs(direction) < 1e-12:
        return (start, end) if 0.0 <= position < cells else (1.0, 0.0)
    a, b = -position / direction, (cells - position) / direction
    return max(start, min(a, b)), min(end, max(a, b))
