"""The compiled horizon sweep: which surface cells a camera sees.

Here positions are in cells, counted from the centre of the grid's first cell, and heights in metres. An
azimuth is walked in steps of one cell along the axis that it is nearer to (the major one), so that a ray
meets the surface where it crosses a line of cell centres. Slopes are metres per cell of the major axis.
"""

from __future__ import annotations

import math

import numba
import numpy as np

#: Steps that are looked up before the horizon is asked for: long enough to be fast, short enough to stop
#: soon.
CHUNK = 32


@numba.njit(cache=True, error_model="numpy")
def frustum(outline):  # type: ignore[no-untyped-def]
    """Where a picture points: its first azimuth, the width of its azimuths, its greatest reach.

    outline: (N, 3) directions around the picture, east, north, up, in order. Azimuths are radians clockwise
    from north. The reach is in horizontal metres per metre of height above the ground, infinite if the
    picture holds a horizontal direction.
    """
    n = outline.shape[0]
    reach, turned, least, most = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        x, y, up = outline[i]
        reach = max(reach, math.hypot(x, y) / -up) if up < 0.0 else np.inf
        after = outline[i + 1 if i + 1 < n else 0]
        turned += _wrapped(math.atan2(after[0], after[1]) - math.atan2(x, y))
        least, most = min(least, turned), max(most, turned)
    if abs(turned) > math.pi:  # the outline runs once around a pole, so the picture holds every azimuth
        return 0.0, 2.0 * math.pi, reach
    return math.atan2(outline[0, 0], outline[0, 1]) + least, most - least, reach


@numba.njit(cache=True, error_model="numpy")
def _wrapped(angle):  # type: ignore[no-untyped-def]
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@numba.njit(cache=True, error_model="numpy")
def sweep(heights, position, outline, azimuths, far, lowest, highest, window, stamps, seen):  # type: ignore[no-untyped-def]
    """Walk outward along each azimuth and keep what rises above the horizon so far and lies in the picture.

    heights: (rows, columns), NaN unknown. position: (3,) camera. outline: (N, 3) directions around the
    picture, metres per cell of horizontal way. azimuths: first, width and number. far: horizontal reach,
    cells. lowest, highest: heights of the terrain within reach. window: first row, first column and bits of
    the part of the grid within reach; its cell (r, c) is number r << bits | c. stamps: uint8 (window's
    cells,). seen: int32 (window's cells + 1,), gets the number of each seen cell once. Returns how many.
    """
    stamps[:] = 0
    slope, cell = np.empty(CHUNK), np.empty(CHUNK, dtype=np.int32)
    first, width, count = azimuths
    row, column, bits = window
    by_column = (column, 1, row, 1 << bits)  # first line and its stride, first place on a line and its stride
    by_row = (row, 1 << bits, column, 1)
    found = 0
    for i in range(count + 1):
        azimuth = first + width / count * i
        east, north = math.sin(azimuth), math.cos(azimuth)
        low, top = slopes(outline, east, north)
        if low >= top:
            continue
        # nearer, the picture is above the highest cell; farther, it is below the lowest: one step to notice
        start = min((highest - position[2]) / low, far) if low < 0.0 and position[2] > highest else 0.0
        end = 1.5 + (min((lowest - position[2]) / top, far) if top < 0.0 else far)
        if abs(east) >= abs(north):
            ray = _ray(position[0], position[1], east, north, start, end, heights.shape[1], heights.shape[0])
            found = _walk(heights.T, position[2], ray, low, top, by_column, slope, cell, stamps, seen, found)
        else:
            ray = _ray(position[1], position[0], north, east, start, end, heights.shape[0], heights.shape[1])
            found = _walk(heights, position[2], ray, low, top, by_row, slope, cell, stamps, seen, found)
    return found


@numba.njit(cache=True, error_model="numpy")
def _ray(major, minor, toward_major, toward_minor, start, end, lines, across):  # type: ignore[no-untyped-def]
    """A ray's first line of centres, its direction (+1 or -1), its steps, and at the first line: the way
    there along the major axis, and the place on the line; and how the place moves per step; and the way
    (greater than 1) per step.
    """
    start, end = _clip(major, toward_major, lines, start, end)
    start, end = _clip(minor, toward_minor, across, start, end)
    sign = 1 if toward_major > 0.0 else -1
    line = sign * math.ceil(sign * (major + start * toward_major))
    way = (line - major) * sign
    steps = max(math.floor(end * abs(toward_major) - way) + 1, 0) if end >= start else 0
    move = toward_minor / abs(toward_major)
    return line, sign, steps, way, minor + way * move, move, 1.0 / abs(toward_major)


@numba.njit(cache=True, error_model="numpy")
def _walk(heights, height, ray, low, top, numbers, slope, cell, stamps, seen, found):  # type: ignore[no-untyped-def]
    """One azimuth of the sweep, from the picture's lower edge or the horizon so far up to its upper edge."""
    steps, length = ray[2], ray[6]
    horizon, top, before = low * length, top * length, np.nan
    for first in range(0, steps, CHUNK):
        last = min(first + CHUNK, steps)
        look_up(heights, height, ray, first, last, numbers, slope, cell)
        for k in range(last - first):
            here = slope[k]
            if here > horizon:
                if before < horizon:  # comes into sight on the way here
                    rise = first + k - 1 + (horizon - before) / (here - before)
                    found = _stamp(_number(rise, ray, numbers, heights), stamps, seen, found)
                if here > top:
                    if before < top:  # leaves the picture on the way here
                        leave = first + k - 1 + (top - before) / (here - before)
                        found = _stamp(_number(leave, ray, numbers, heights), stamps, seen, found)
                    return found
                found = _stamp(cell[k], stamps, seen, found)
                horizon = here
            before = here
    return found


@numba.njit(cache=True, error_model="numpy")
def look_up(heights, height, ray, first, last, numbers, slope, cell):  # type: ignore[no-untyped-def]
    """The slopes from the camera to the surface at some steps of a ray, and the numbers of the cells there.

    heights: its rows are the lines.
    """
    line, sign, _, way, place, move, _ = ray
    first_line, line_stride, first_place, place_stride = numbers
    most = heights.shape[1] - 1
    for k in range(first, last):
        x = min(max(place + k * move, 0.0), float(most))  # level in the outer half cells
        i = min(int(x), max(most - 1, 0))
        near, after = heights[line + sign * k, i], heights[line + sign * k, min(i + 1, most)]
        slope[k - first] = (near + (after - near) * (x - i) - height) / (way + k)
        across = (int(x + 0.5) - first_place) * place_stride
        cell[k - first] = (line + sign * k - first_line) * line_stride + across


@numba.njit(cache=True, error_model="numpy")
def _number(step, ray, numbers, heights):  # type: ignore[no-untyped-def]
    """The number of the cell at a step, whole or not, of a ray."""
    line, sign, _, _, place, move, _ = ray
    first_line, line_stride, first_place, place_stride = numbers
    along = min(max(int(line + sign * step + 0.5), 0), heights.shape[0] - 1)
    across = min(max(int(place + move * step + 0.5), 0), heights.shape[1] - 1)
    return (along - first_line) * line_stride + (across - first_place) * place_stride


@numba.njit(cache=True, error_model="numpy")
def _stamp(number, stamps, seen, found):  # type: ignore[no-untyped-def]
    """Note a cell unless it is noted already; returns how many are. No branch: it would be guessed wrong."""
    seen[found] = number
    found += 1 - stamps[number]
    stamps[number] = 1
    return found


@numba.njit(cache=True, error_model="numpy")
def _clip(position, direction, cells, start, end):  # type: ignore[no-untyped-def]
    """The part of start..end on which position + t * direction lies on the cells."""
    if abs(direction) < 1e-12:
        return (start, end) if -0.5 <= position < cells - 0.5 else (1.0, 0.0)
    a, b = (-0.5 - position) / direction, (cells - 0.5 - position) / direction
    return max(start, min(a, b)), min(end, max(a, b))


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
