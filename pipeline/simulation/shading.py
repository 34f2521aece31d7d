"""The colour of what a ray meets: numba kernels, one pass over the pixels.

All colours are linear RGB. Lambert's law for the sun, a sky brighter above, a little haze with distance.
"""

from __future__ import annotations

import numba
import numpy as np

_HAZE_M = 1400.0
_FADE_M = 45.0


@numba.njit(cache=True, fastmath=True, inline="always")
def _periodic(grid, x, y, channel):  # type: ignore[no-untyped-def]
    """Bilinear value of a grid (n, n, channels), n a power of two, that goes on for ever; x, y in cells."""
    last = grid.shape[0] - 1
    fx, fy = np.floor(x), np.floor(y)
    c, r = int(fx) & last, int(fy) & last
    c1, r1 = (c + 1) & last, (r + 1) & last
    a, b = x - fx, y - fy
    low = grid[r, c, channel] * (1 - a) + grid[r, c1, channel] * a
    high = grid[r1, c, channel] * (1 - a) + grid[r1, c1, channel] * a
    return low * (1 - b) + high * b


@numba.njit(cache=True, fastmath=True, inline="always")
def _corner(grid, x, y):  # type: ignore[no-untyped-def]
    """Row, column and fractions of the four cells around a position, in cells from the first one's centre."""
    rows, columns = grid.shape[0], grid.shape[1]
    x, y = min(max(x, 0.0), columns - 1.001), min(max(y, 0.0), rows - 1.001)
    c, r = int(x), int(y)
    return r, c, x - c, y - r


@numba.njit(cache=True, fastmath=True, inline="always")
def _mixed(grid, r, c, a, b, channel):  # type: ignore[no-untyped-def]
    low = grid[r, c, channel] * (1 - a) + grid[r, c + 1, channel] * a
    high = grid[r + 1, c, channel] * (1 - a) + grid[r + 1, c + 1, channel] * a
    return low * (1 - b) + high * b


@numba.njit(cache=True)
def rotated(rays, rotation):  # type: ignore[no-untyped-def]
    """Directions float32 (N, 3) after a rotation (3, 3); faster than a product of matrices this thin."""
    out = np.empty_like(rays)
    for i in range(rays.shape[0]):
        for k in range(3):
            out[i, k] = (
                rotation[k, 0] * rays[i, 0] + rotation[k, 1] * rays[i, 1] + rotation[k, 2] * rays[i, 2]
            )
    return out


@numba.njit(cache=True, fastmath=True)
def shade_static(  # type: ignore[no-untyped-def]
    face, u, v, distance, rays, origin, dimmed,
    faces, normals, albedo, grain, sun_share, ground_faces,
    tiles, means, texel_m, soil, soil_cell_m, ground_light, light_corner, light_cell_m,
    sun_direction, sun, sky, haze, out,
):  # fmt: skip
    """Fill out (N, 3) for every pixel whose ray meets the ground or a thing.

    face, u, v, distance: (N,), of caster.Hits. dimmed: bool (N,), in somebody's shadow. means: (5, 3), of the
    tiles. The rest: of Scene, Ground and GroundLight.
    """
    base = np.empty(3, np.float32)
    for i in range(face.shape[0]):
        f = face[i]
        if f < 0:
            for k in range(3):
                out[i, k] = haze[k]
            continue
        d = distance[i]
        x, y = origin[0] + d * rays[i, 0], origin[1] + d * rays[i, 1]
        p, q, w = faces[f, 0], faces[f, 1], faces[f, 2]
        wu, wv = u[i], v[i]
        wp = 1.0 - wu - wv
        nx = wp * normals[p, 0] + wu * normals[q, 0] + wv * normals[w, 0]
        ny = wp * normals[p, 1] + wu * normals[q, 1] + wv * normals[w, 1]
        nz = wp * normals[p, 2] + wu * normals[q, 2] + wv * normals[w, 2]
        length = np.sqrt(nx * nx + ny * ny + nz * nz) + 1e-9
        nx, ny, nz = nx / length, ny / length, nz / length
        fade = 1.0 / (1.0 + (d / _FADE_M) ** 4)
        if f < ground_faces:
            sx, sy = x / soil_cell_m, y / soil_cell_m
            bright = _periodic(soil, sx, sy, 4)
            base[:] = 0.0
            for kind in range(4):
                share = _periodic(soil, sx, sy, kind)
                if share > 0.03:
                    for k in range(3):
                        fine = _periodic(tiles[kind], x / texel_m, y / texel_m, k)
                        base[k] += share * bright * (means[kind, k] + fade * (fine - means[kind, k]))
            r, c, a, b = _corner(
                ground_light,
                (x - light_corner[0]) / light_cell_m - 0.5,
                (y - light_corner[1]) / light_cell_m - 0.5,
            )
            lit = _mixed(ground_light, r, c, a, b, 0)
            open_sky = _mixed(ground_light, r, c, a, b, 1)
        else:
            z = origin[2] + d * rays[i, 2]
            s, t = (x, y) if abs(nz) > 0.6 else ((y, z) if abs(nx) > abs(ny) else (x, z))
            fine = _periodic(tiles[4], 1.7 * s / texel_m, 1.7 * t / texel_m, 0)
            rough = wp * grain[p] + wu * grain[q] + wv * grain[w]
            scale = 1.0 + rough * fade * (fine - 1.0)
            for k in range(3):
                base[k] = scale * (wp * albedo[p, k] + wu * albedo[q, k] + wv * albedo[w, k])
            lit = wp * sun_share[p] + wu * sun_share[q] + wv * sun_share[w]
            open_sky = 0.9
        if dimmed[i]:
            lit = 0.0
        direct = lit * max(nx * sun_direction[0] + ny * sun_direction[1] + nz * sun_direction[2], 0.0)
        ambient = open_sky * (0.62 + 0.38 * nz)
        clear = np.exp(-d / _HAZE_M)
        for k in range(3):
            out[i, k] = clear * base[k] * (direct * sun[k] + ambient * sky[k]) + (1.0 - clear) * haze[k]


@numba.njit(cache=True, fastmath=True)
def shade_body(  # type: ignore[no-untyped-def]
    face, u, v, lit, faces, normals, albedo, local, sun_direction, sun, sky, out
):
    """Fill out (N, 3) for the pixels of one person.

    lit: bool (N,), in the sun. local: (V,), brightness of the cloth at each vertex.
    """
    for i in range(face.shape[0]):
        p, q, w = faces[face[i], 0], faces[face[i], 1], faces[face[i], 2]
        wu, wv = u[i], v[i]
        wp = 1.0 - wu - wv
        nx = wp * normals[p, 0] + wu * normals[q, 0] + wv * normals[w, 0]
        ny = wp * normals[p, 1] + wu * normals[q, 1] + wv * normals[w, 1]
        nz = wp * normals[p, 2] + wu * normals[q, 2] + wv * normals[w, 2]
        length = np.sqrt(nx * nx + ny * ny + nz * nz) + 1e-9
        facing = (nx * sun_direction[0] + ny * sun_direction[1] + nz * sun_direction[2]) / length
        direct = max(facing, 0.0) if lit[i] else 0.0
        ambient = 0.58 + 0.36 * nz / length
        cloth = wp * local[p] + wu * local[q] + wv * local[w]
        for k in range(3):
            color = cloth * (wp * albedo[p, k] + wu * albedo[q, k] + wv * albedo[w, k])
            out[i, k] = color * (direct * sun[k] + ambient * sky[k])


@numba.njit(cache=True, fastmath=True)
def expose(linear, noise, noise_levels, blur, out):  # type: ignore[no-untyped-def]
    """The lens and the sensor: linear (H, W, 3) to out uint8 (H, W, 3).

    blur: weight of each direct neighbour in the 3 x 3 kernel. noise: standard normal (H, W).
    noise_levels: its deviation, in levels of 0..255.
    """
    height, width = linear.shape[0], linear.shape[1]
    middle = 1.0 - 2.0 * blur
    for y in range(height):
        up, down = max(y - 1, 0), min(y + 1, height - 1)
        for x in range(width):
            left, right = max(x - 1, 0), min(x + 1, width - 1)
            speck = noise_levels * noise[y, x]
            for k in range(3):
                above = middle * linear[up, x, k] + blur * (linear[up, left, k] + linear[up, right, k])
                here = middle * linear[y, x, k] + blur * (linear[y, left, k] + linear[y, right, k])
                below = middle * linear[down, x, k] + blur * (linear[down, left, k] + linear[down, right, k])
                value = 255.0 * np.sqrt(max(middle * here + blur * (above + below), 0.0)) + speck
                out[y, x, k] = np.uint8(min(max(value + 0.5, 0.0), 255.0))
