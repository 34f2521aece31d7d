"""The compiled choice of the seen cells that a frame speaks for.

Positions are in cells, counted from the centre of the grid's first cell, heights in metres. Pixels are
homogeneous: (U, V, Z) is the pixel (U / Z, V / Z), so the sides of boxes and of the picture are planes, which
cost no division; and what lies behind the camera is on no side's inner side.
"""

from __future__ import annotations

import math

import numba
import numpy as np


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

    object_height: metres; above 0, an object of this height at the cell must also be whole in the picture:
    standing, or lying, half its height around the centre. picture: width and height, pixels.

    toward_camera: (3, 3), columns: camera-frame metres per cell east, per cell north and per metre up. lens:
    (12,) fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6. window: as in sweep. cells: int32 (2, >=N), distances: float64
    (>=N,), get row, column and distance of the centre, metres. Returns how many.
    """
    row, column, bits = window
    column_bits = (1 << bits) - 1
    place_x, place_y, place_up = position
    east, north, rise = _to_pixels(toward_camera, lens)
    bent, whole = lens[4:].any(), object_height > 0.0
    left, right, top, bottom = -np.inf, -np.inf, -np.inf, -np.inf
    if whole and not bent:
        left, right, top, bottom = _borders(rise, object_height, lens, picture)
    kept = 0
    for i in range(seen.size):
        r, c = row + (seen[i] >> bits), column + (seen[i] & column_bits)
        x, y, up = c - place_x, r - place_y, heights[r, c] - place_up
        distance = math.sqrt((x * x + y * y) * cell_m * cell_m + up * up)
        u = x * east[0] + y * north[0] + up * rise[0]
        v = x * east[1] + y * north[1] + up * rise[1]
        z = x * east[2] + y * north[2] + up * rise[2]
        good = distance <= max_distance
        good &= (u >= left) & (picture[0] * z - u >= right) & (v >= top) & (picture[1] * z - v >= bottom)
        if bent:
            if whole:
                good &= _is_whole_bent(u, v, z, rise, object_height, lens, picture)
            u, v = _bend(u, v, z, lens)
        for j in range(boxes.shape[0]):
            good &= (
                (u < boxes[j, 0] * z) | (u > boxes[j, 2] * z) | (v < boxes[j, 1] * z) | (v > boxes[j, 3] * z)
            )
        cells[0, kept], cells[1, kept] = r, c
        distances[kept] = distance
        kept += good  # no branch: it would be guessed wrong
    return kept


@numba.njit(cache=True, error_model="numpy")
def _to_pixels(toward_camera, lens):  # type: ignore[no-untyped-def]
    """Homogeneous pixels (3,) per cell east, per cell north, per metre up; the lens without distortion."""
    a, b, c = toward_camera
    u, v = lens[0] * a + lens[2] * c, lens[1] * b + lens[3] * c
    return (u[0], v[0], c[0]), (u[1], v[1], c[1]), (u[2], v[2], c[2])


@numba.njit(cache=True, error_model="numpy")
def _borders(rise, height, lens, picture):  # type: ignore[no-untyped-def]
    """The least U, width Z - U, V and height Z - V of a foot whose object is whole, standing and lying."""
    u, v, z = height * rise[0], height * rise[1], height * rise[2]
    lying_u, lying_v = 0.5 * height * lens[0], 0.5 * height * lens[1]
    return (
        max(lying_u, -u),
        max(lying_u, u - picture[0] * z),
        max(lying_v, -v),
        max(lying_v, v - picture[1] * z),
    )


@numba.njit(cache=True, error_model="numpy")
def _is_whole_bent(u, v, z, rise, height, lens, picture):  # type: ignore[no-untyped-def]
    """The same through a distorted lens, foot and head one after the other."""
    head_z = z + height * rise[2]
    head_u, head_v = _bend(u + height * rise[0], v + height * rise[1], head_z, lens)
    u, v = _bend(u, v, z, lens)
    lying_u, lying_v = 0.5 * height * lens[0], 0.5 * height * lens[1]
    return (
        (u >= lying_u)
        & (u <= picture[0] * z - lying_u)
        & (v >= lying_v)
        & (v <= picture[1] * z - lying_v)
        & (head_u >= 0.0)
        & (head_u <= picture[0] * head_z)
        & (head_v >= 0.0)
        & (head_v <= picture[1] * head_z)
    )


@numba.njit(cache=True, error_model="numpy")
def _bend(u, v, z, lens):  # type: ignore[no-untyped-def]
    """The homogeneous pixel to which the lens's distortion moves this one."""
    x, y = (u / z - lens[2]) / lens[0], (v / z - lens[3]) / lens[1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]))
    radial /= 1.0 + r2 * (lens[9] + r2 * (lens[10] + r2 * lens[11]))
    bent_x = x * radial + 2.0 * lens[6] * x * y + lens[7] * (r2 + 2.0 * x * x)
    bent_y = y * radial + lens[6] * (r2 + 2.0 * y * y) + 2.0 * lens[7] * x * y
    return (bent_x * lens[0] + lens[2]) * z, (bent_y * lens[1] + lens[3]) * z
