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
    (9,) fx, fy, cx, cy, k1, k2, p1, p2, k3. window: as in sweep. cells: int32 (2, >=N), distances: float64
    (>=N,), get row, column and distance of the centre, metres. Returns how many.
    """
    row, column, bits = window
    to_pixels = _to_pixels(toward_camera, lens)
    head = object_height * to_pixels[:, 2]
    bent, lying, bounded = lens[4:].any(), 0.5 * object_height, object_height > 0.0
    kept = 0
    for i in range(seen.size):
        r, c = row + (seen[i] >> bits), column + (seen[i] & ((1 << bits) - 1))
        x, y, up = c - position[0], r - position[1], heights[r, c] - position[2]
        distance = math.sqrt((x * x + y * y) * cell_m * cell_m + up * up)
        good = distance <= max_distance
        u = x * to_pixels[0, 0] + y * to_pixels[0, 1] + up * to_pixels[0, 2]
        v = x * to_pixels[1, 0] + y * to_pixels[1, 1] + up * to_pixels[1, 2]
        z = x * to_pixels[2, 0] + y * to_pixels[2, 1] + up * to_pixels[2, 2]
        if bounded:
            head_u, head_v, head_z = u + head[0], v + head[1], z + head[2]
            if bent:
                head_u, head_v = _bend(head_u, head_v, head_z, lens)
            good &= _inside(head_u, head_v, head_z, 0.0, 0.0, picture)
        if bent:
            u, v = _bend(u, v, z, lens)
        if bounded:
            good &= _inside(u, v, z, lying * lens[0], lying * lens[1], picture)
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
    """toward_camera, but to the homogeneous pixels of the lens without its distortion."""
    to_pixels = np.empty((3, 3))
    to_pixels[0] = lens[0] * toward_camera[0] + lens[2] * toward_camera[2]
    to_pixels[1] = lens[1] * toward_camera[1] + lens[3] * toward_camera[2]
    to_pixels[2] = toward_camera[2]
    return to_pixels


@numba.njit(cache=True, error_model="numpy")
def _inside(u, v, z, margin_u, margin_v, picture):  # type: ignore[no-untyped-def]
    """Whether a homogeneous pixel lies at least margin_u / z and margin_v / z pixels inside the picture."""
    return (
        (u >= margin_u)
        & (u <= picture[0] * z - margin_u)
        & (v >= margin_v)
        & (v <= picture[1] * z - margin_v)
    )


@numba.njit(cache=True, error_model="numpy")
def _bend(u, v, z, lens):  # type: ignore[no-untyped-def]
    """The homogeneous pixel to which the lens's distortion moves this one."""
    x, y = (u / z - lens[2]) / lens[0], (v / z - lens[3]) / lens[1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]))
    bent_x = x * radial + 2.0 * lens[6] * x * y + lens[7] * (r2 + 2.0 * x * x)
    bent_y = y * radial + lens[6] * (r2 + 2.0 * y * y) + 2.0 * lens[7] * x * y
    return (bent_x * lens[0] + lens[2]) * z, (bent_y * lens[1] + lens[3]) * z
