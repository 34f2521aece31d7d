"""Terrains that are not read from a surface model: planes, and meshes seen from above."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numba
import numpy as np

from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.terrain import Terrain

if TYPE_CHECKING:
    import trimesh


def plane(
    frame: LocalFrame,
    west_m: float,
    south_m: float,
    east_m: float,
    north_m: float,
    cell_m: float,
    height_m: float,
) -> Terrain:
    """A level terrain of one height that covers a rectangle of the map frame."""
    shape = math.ceil((north_m - south_m) / cell_m), math.ceil((east_m - west_m) / cell_m)
    return Terrain(frame, west_m, south_m, cell_m, np.full(shape, height_m, dtype=np.float32))


def load_mesh(path: Path, cell_m: float, frame: LocalFrame) -> Terrain:
    """The terrain of a mesh file, see sampled_mesh; the frame's origin is the mesh's (0, 0)."""
    if not path.is_file():
        raise InputError(path, "no file", "a mesh")
    import trimesh  # takes half a second and 20 MB, and few missions have a mesh

    try:
        mesh = trimesh.load_mesh(path)
    except Exception as error:  # each of trimesh's readers raises what it likes
        raise InputError(path, f"a file that is no mesh ({type(error).__name__})", "a mesh") from None
    try:
        return sampled_mesh(mesh, frame, cell_m)
    except InputError as error:
        raise InputError(path, error.found, error.expected) from None


def sampled_mesh(mesh: trimesh.Trimesh, frame: LocalFrame, cell_m: float) -> Terrain:
    """The highest surface of a mesh (x east, y north, z up, metres) over the centre of each cell.

    NaN where the mesh has no surface. Raises InputError if it has none at all.
    """
    triangles = np.asarray(mesh.triangles, dtype=np.float64)
    if not len(triangles) or not np.isfinite(triangles).all():
        raise InputError("mesh", f"{len(triangles)} triangles", "triangles with finite corners")
    west_m, south_m = np.floor(triangles[..., :2].min(axis=(0, 1)) / cell_m) * cell_m
    size = np.ceil((triangles[..., :2].max(axis=(0, 1)) - (west_m, south_m)) / cell_m).astype(int)
    heights = np.full((max(size[1], 1), max(size[0], 1)), np.nan, dtype=np.float32)
    corner = np.array([west_m, south_m, 0.0])
    _rasterize((triangles - corner) / (cell_m, cell_m, 1.0) - (0.5, 0.5, 0.0), heights)
    if np.isnan(heights).all():
        raise InputError("mesh", "no surface over the centre of any cell", "a smaller cell_size")
    return Terrain(frame, float(west_m), float(south_m), cell_m, heights)


@numba.njit(cache=True)
def _rasterize(triangles, heights):  # type: ignore[no-untyped-def]
    """Raise heights to the triangles (N, 3, 3); x and y in cells from the centre of the first cell."""
    rows, columns = heights.shape
    for n in range(triangles.shape[0]):
        a, b, c = triangles[n]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if area == 0.0:
            continue
        first, last = math.ceil(min(a[1], b[1], c[1])), math.floor(max(a[1], b[1], c[1]))
        left, right = math.ceil(min(a[0], b[0], c[0])), math.floor(max(a[0], b[0], c[0]))
        for y in range(max(first, 0), min(last + 1, rows)):
            for x in range(max(left, 0), min(right + 1, columns)):
                v = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area
                w = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area
                if v >= -1e-9 and w >= -1e-9 and v + w <= 1.0 + 1e-9:
                    z = a[2] + v * (b[2] - a[2]) + w * (c[2] - a[2])
                    if not heights[y, x] >= z:
                        heights[y, x] = z
