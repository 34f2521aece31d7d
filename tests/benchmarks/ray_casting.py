"""What a camera sees, by brute force: rays through every pixel, each met exactly with the surface."""

import math

import numba  # no cache: it would be bound to the one name under which it was imported first
import numpy as np


def cells_hit(terrain, camera, pose, rays_per_pixel_side, reach_m):
    """bool (rows, columns): the cells in which a ray ends, of rays_per_pixel_side^2 rays in every pixel."""
    k = rays_per_pixel_side
    u, v = (np.arange(n * k) / k + 0.5 / k for n in (camera.width, camera.height))
    hit = np.zeros(terrain.shape, dtype=np.bool_)
    position = np.array(
        [
            (pose.position_enu[0] - terrain.east_m) / terrain.cell_m - 0.5,
            (pose.position_enu[1] - terrain.north_m) / terrain.cell_m - 0.5,
            pose.position_enu[2],
        ]
    )
    scale = np.array([terrain.cell_m, terrain.cell_m, 1.0])
    top = float(np.nanmax(terrain.heights_m))
    for row in v:
        rays = camera.rays_enu(np.stack([u, np.full(u.size, row)], axis=1), pose)
        _cast(np.asarray(terrain.heights_m), position, rays / scale, top, reach_m, hit)
    return hit


@numba.njit(error_model="numpy")
def _cast(heights, position, rays, top, reach, hit):
    """Mark the cell where each ray (N, 3), cells and metres per metre of way, first meets the surface."""
    rows, columns = heights.shape
    for n in range(rays.shape[0]):
        dx, dy, dz = rays[n, 0], rays[n, 1], rays[n, 2]
        t = max((top - position[2]) / dz, 0.0) if dz < 0.0 else 0.0
        i, j = math.floor(position[0] + t * dx), math.floor(position[1] + t * dy)
        while t < reach:
            # the way out of the square between four centres
            tx = ((i + 1 if dx > 0.0 else i) - position[0]) / dx if dx != 0.0 else np.inf
            ty = ((j + 1 if dy > 0.0 else j) - position[1]) / dy if dy != 0.0 else np.inf
            out = min(tx, ty)
            met = _meet(heights, i, j, position, dx, dy, dz, t, out)
            if met >= 0.0:
                if met <= reach:
                    c, r = (
                        math.floor(position[0] + met * dx + 0.5),
                        math.floor(position[1] + met * dy + 0.5),
                    )
                    if 0 <= c < columns and 0 <= r < rows:
                        hit[r, c] = True
                break
            if tx <= ty:
                i += 1 if dx > 0.0 else -1
            else:
                j += 1 if dy > 0.0 else -1
            t = max(t, out)
            if (
                (i < -1 and dx <= 0.0)
                or (i >= columns and dx >= 0.0)
                or (j < -1 and dy <= 0.0)
                or (j >= rows and dy >= 0.0)
            ):
                break


@numba.njit(error_model="numpy")
def _meet(heights, i, j, position, dx, dy, dz, t0, t1):
    """The first t in t0..t1 at which the ray is on or under the bilinear surface, or -1."""
    rows, columns = heights.shape
    if i < -1 or j < -1 or i >= columns or j >= rows:
        return -1.0
    i0, i1, j0, j1 = max(i, 0), min(i + 1, columns - 1), max(j, 0), min(j + 1, rows - 1)
    a, b, c, d = (
        float(heights[j0, i0]),
        float(heights[j0, i1]),
        float(heights[j1, i0]),
        float(heights[j1, i1]),
    )
    if not min(position[2] + t0 * dz, position[2] + t1 * dz) <= max(a, b, c, d):
        return -1.0
    b, c, d = b - a, c - a, d - b - c + a
    u, v = position[0] + t0 * dx - i, position[1] + t0 * dy - j
    f0 = position[2] + t0 * dz - (a + b * u + c * v + d * u * v)
    if f0 <= 0.0:
        return t0
    f1 = dz - (b * dx + c * dy + d * (u * dy + v * dx))
    f2 = -d * dx * dy
    s = _first_root(f0, f1, f2)
    return t0 + s if s <= t1 - t0 else -1.0


@numba.njit(error_model="numpy")
def _first_root(f0, f1, f2):
    """The least s > 0 with f0 + f1 s + f2 s^2 = 0, infinite if there is none; f0 > 0."""
    if abs(f2) < 1e-15:
        return -f0 / f1 if f1 < 0.0 else np.inf
    discriminant = f1 * f1 - 4.0 * f2 * f0
    if discriminant < 0.0:
        return np.inf
    q = -0.5 * (f1 + math.copysign(math.sqrt(discriminant), f1))
    low, high = min(q / f2, f0 / q), max(q / f2, f0 / q)
    return low if low > 0.0 else (high if high > 0.0 else np.inf)
