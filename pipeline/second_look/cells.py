"""Which cells of the map lie in an area."""

from __future__ import annotations

import numpy as np
import rasterio
import rasterio.features
from numpy.typing import NDArray

from pipeline.geo.search_area import SearchArea
from pipeline.geo.terrain import Terrain


def cells_inside(wanted: SearchArea | None, terrain: Terrain) -> NDArray[np.bool_]:
    """Cells (rows, columns) whose middle lies in the area; those that it touches, if it is smaller than a cell."""
    if wanted is None:
        return np.zeros(terrain.shape, dtype=bool)
    shapes = [
        {"type": "Polygon", "coordinates": [[*map(tuple, ring), tuple(ring[0])] for ring in rings]}
        for rings in wanted.polygons
    ]
    cell = terrain.cell_m
    transform = rasterio.Affine(cell, 0.0, terrain.east_m, 0.0, cell, terrain.north_m)
    for all_touched in (False, True):
        inside = rasterio.features.geometry_mask(
            shapes, terrain.shape, transform, all_touched=all_touched, invert=True
        )
        if inside.any():
            break
    return np.asarray(inside, dtype=bool)
