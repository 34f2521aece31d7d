"""The second look of a mission: what was to be searched, what is worth another look, how to fly there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from pipeline.config.fusion import Fusion
from pipeline.config.prior import Prior
from pipeline.config.second_look import SecondLook
from pipeline.fusion.voxel_map import VoxelMap
from pipeline.geo.camera import Camera
from pipeline.geo.search_area import SearchArea, load_search_area
from pipeline.geo.terrain import Terrain
from pipeline.logs import Log
from pipeline.messages import FloatArray
from pipeline.second_look.areas import SecondLookArea, layers_of, second_look_areas
from pipeline.second_look.cells import cells_inside
from pipeline.second_look.coverage import Coverage
from pipeline.second_look.flight import SecondFlight, plan_second_flight
from pipeline.second_look.prior import Remaining, area_probability, remaining

_LOG = Log("second_look")


@dataclass(frozen=True, eq=False)
class SecondLookPlan:
    """areas: the most worth first. flight: over them. coverage: of the ground that was to be searched.
    remaining: of the prior; None without one.
    """

    areas: tuple[SecondLookArea, ...]
    flight: SecondFlight
    coverage: Coverage
    remaining: Remaining | None = None


def plan_second_look(
    voxel_map: VoxelMap,
    terrain: Terrain,
    fusion: Fusion,
    camera: Camera,
    tracks: Mapping[str, FloatArray],
    search_area: Path | None,
    takeoff_m: float = math.nan,
    prior: Prior | None = None,
) -> SecondLookPlan:
    """camera: of the first stream, which flies again. tracks: stream -> positions, float64 (N, >=2).

    takeoff_m: height of the first stream's take-off, above the terrain's datum; NaN: not known. prior: where the person
    may be; None: as likely everywhere.
    """
    wanted = wanted_ground(search_area, terrain, tracks, fusion.second_look)
    searched = cells_inside(wanted, terrain)
    layers, corner = layers_of(voxel_map), (terrain.east_m, terrain.north_m)
    poa = None if prior is None else area_probability(prior, terrain)
    areas = second_look_areas(layers, searched, corner, terrain.cell_m, fusion, poa)
    home = next(iter(tracks.values()))[0, :2]
    flight = plan_second_flight(areas, camera, terrain, home, fusion.second_look, takeoff_m)
    judged, seen, cell_m2 = (
        searched & np.isfinite(terrain.heights_m),
        layers.observations > 0,
        terrain.cell_m**2,
    )
    left = None if poa is None else remaining(poa, np.where(seen, layers.pod, 0.0))
    coverage = Coverage(
        "none" if wanted is None else "area" if search_area is not None else "ways",
        0.0 if wanted is None else wanted.area_m2,
        float(judged.sum()) * cell_m2,
        float((judged & seen).sum()) * cell_m2,
        float(seen.sum()) * cell_m2,
        float(np.where(seen, layers.pod, 0.0)[judged].mean()) if judged.any() else None,
        None if left is None else left.pos,
        None if left is None else left.on_map,
    )
    _LOG.event(
        "planned",
        basis=coverage.basis,
        areas=len(areas),
        length_m=round(flight.length_m, 1),
        takeoff_m=round(flight.takeoff_m, 2),
        takeoff_is_told=flight.takeoff_is_told,
        clearance=flight.clearance,
    )
    return SecondLookPlan(areas, flight, coverage, left)


def wanted_ground(
    area: Path | None, terrain: Terrain, tracks: Mapping[str, FloatArray], params: SecondLook
) -> SearchArea | None:
    """The mission's search area, or the hull of the tracks; None where they enclose nothing.

    A drone that hovers or flies one straight line encloses nothing, nor does one whose positions only wander about
    such a line.
    """
    if area is not None:
        return load_search_area(area, terrain.frame)
    points = np.concatenate([track[:, :2] for track in tracks.values()])
    try:
        hull = points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        return None
    return SearchArea(((hull,),)) if _least_width_m(hull) >= params.ways_width_min else None


def _least_width_m(hull: FloatArray) -> float:
    """The distance of two parallel lines that hold the hull (N, 2) between them: one of them lies on an edge."""
    edges = np.roll(hull, -1, axis=0) - hull
    normals = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
    return float(np.ptp(hull @ normals.T, axis=0).min())
