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


@numba.njit(cache=True, error_model="numpy")
def select(  # type: ignore[no-untyped-def]
    heights,
    position,
    cell_m,
    toward_camera,
    lens,
    picture,
    boxes,
    object_height,
    max_distance,
    window,
    seen,
    cells,
    distances,
):
    """Of the seen cells (N,) those whose centre is within max_distance (metres) and in no box (M, 4).

    object_height: metres; above 0, an object of this height at the cell must also be whole in the picture.
    picture: width and height, pixels.

    toward_camera: (3, 3), columns: camera-frame metres per cell east, per cell north and per metre up. lens:
    (9,) fx, fy, cx, cy, k1, k2, p1, p2, k3. window: as in sweep. cells: int32 (2, >=N), distances: float64
    (>=N,), get row, column and distance of the centre, metres. Returns how many.
    """
    row, column, bits = window
    kept = 0
    for i in range(seen.size):
        r, c = row + (seen[i] >> bits), column + (seen[i] & ((1 << bits) - 1))
        x, y = c - position[0], r - position[1]
        up = heights[r, c] - position[2]
        distance = math.sqrt((x * x + y * y) * cell_m * cell_m + up * up)
        if not distance <= max_distance:
            continue
        if boxes.shape[0] > 0 or object_height > 0.0:
            px = x * toward_camera[0, 0] + y * toward_camera[0, 1] + up * toward_camera[0, 2]
            py = x * toward_camera[1, 0] + y * toward_camera[1, 1] + up * toward_camera[1, 2]
            pz = x * toward_camera[2, 0] + y * toward_camera[2, 1] + up * toward_camera[2, 2]
            if boxes.shape[0] > 0 and _in_a_box(px, py, pz, lens, boxes):
                continue
            if object_height > 0.0:
                rise = object_height * toward_camera[:, 2]
                if not _whole(px, py, pz, rise, 0.5 * object_height, lens, picture):
                    continue
        cells[0, kept], cells[1, kept] = r, c
        distances[kept] = distance
        kept += 1
    return kept


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
def _whole(x, y, z, rise, reach, lens, picture):  # type: ignore[no-untyped-def]
    """Whether an object at a place, camera frame, is whole in the picture (width, height).

    It may stand, up to rise (3,) from the place, or lie, up to reach around it; all in metres.
    """
    if z <= 1e-9 or z + rise[2] <= 1e-9:
        return False
    u, v = _pixel(x / z, y / z, lens)
    du, dv = reach * lens[0] / z, reach * lens[1] / z
    if u < du or u > picture[0] - du or v < dv or v > picture[1] - dv:
        return False
    u, v = _pixel((x + rise[0]) / (z + rise[2]), (y + rise[1]) / (z + rise[2]), lens)
    return 0.0 <= u <= picture[0] and 0.0 <= v <= picture[1]


@numba.njit(cache=True, error_model="numpy")
def _pixel(x, y, lens):  # type: ignore[no-untyped-def]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]))
    u = x * radial + 2.0 * lens[6] * x * y + lens[7] * (r2 + 2.0 * x * x)
    v = y * radial + lens[6] * (r2 + 2.0 * y * y) + 2.0 * lens[7] * x * y
    return u * lens[0] + lens[2], v * lens[1] + lens[3]
