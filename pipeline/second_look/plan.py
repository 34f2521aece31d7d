"""The second look of a mission: what was to be searched, what is worth another look, how to fly there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
import rasterio.features
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from pipeline.config.fusion import Fusion
from pipeline.fusion.voxel_map import VoxelMap
from pipeline.geo.camera import Camera
from pipeline.geo.search_area import load_search_area
from pipeline.geo.terrain import Terrain
from pipeline.messages import FloatArray
from pipeline.second_look.areas import SecondLookArea, layers_of, second_look_areas
from pipeline.second_look.flight import SecondFlight, plan_second_flight


@dataclass(frozen=True, eq=False)
class SecondLookPlan:
    """areas: the most worth first. flight: over them. searched_m2: of the ground that was to be searched."""

    areas: tuple[SecondLookArea, ...]
    flight: SecondFlight
    searched_m2: float


def plan_second_look(
    voxel_map: VoxelMap,
    terrain: Terrain,
    fusion: Fusion,
    camera: Camera,
    tracks: Mapping[str, FloatArray],
    search_area: Path | None,
) -> SecondLookPlan:
    """camera: of the first stream, which flies again. tracks: stream -> positions, float64 (N, >=2)."""
    searched = searched_cells(search_area, terrain, tracks)
    corner = (terrain.east_m, terrain.north_m)
    areas = second_look_areas(layers_of(voxel_map), searched, corner, terrain.cell_m, fusion)
    home = next(iter(tracks.values()))[0, :2]
    flight = plan_second_flight(areas, camera, terrain, home, fusion.second_look)
    return SecondLookPlan(areas, flight, float(searched.sum()) * terrain.cell_m**2)


def searched_cells(
    area: Path | None, terrain: Terrain, tracks: Mapping[str, FloatArray]
) -> NDArray[np.bool_]:
    """Cells (rows, columns) whose middle lies in the mission's search area, or in the hull of the tracks."""
    if area is None:
        points = np.concatenate([track[:, :2] for track in tracks.values()])
        try:
            polygons: tuple[tuple[FloatArray, ...], ...] = ((points[ConvexHull(points).vertices],),)
        except (QhullError, ValueError):  # a drone that hovers, or flies one straight line, encloses nothing
            return np.zeros(terrain.shape, dtype=bool)
    else:
        polygons = load_search_area(area, terrain.frame).polygons
    shapes = [
        {"type": "Polygon", "coordinates": [[*map(tuple, ring), tuple(ring[0])] for ring in rings]}
        for rings in polygons
    ]
    cell = terrain.cell_m
    transform = rasterio.Affine(cell, 0.0, terrain.east_m, 0.0, cell, terrain.north_m)
    inside = rasterio.features.geometry_mask(shapes, terrain.shape, transform, invert=True)
    return np.asarray(inside, dtype=bool)
