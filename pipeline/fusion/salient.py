"""The places where a person is likely: clusters of probable cells (the paper's sec:extract_salient).

No cell above the threshold is left out, whatever the cell size and the cluster distance: cells that touch are one place
though their middles are farther apart than the cluster distance, a sighting belongs to the cell that it lies in, and a
cluster without any sighting is listed where its cells are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pipeline.config.fusion import Fusion
from pipeline.fusion.error_ellipse import ErrorEllipse, ellipse_of
from pipeline.fusion.error_propagation import place_covariance
from pipeline.fusion.localization import locate, mean_intersection, weights
from pipeline.fusion.look import Look
from pipeline.fusion.published import published_probability
from pipeline.fusion.sightings import count_looks, people_at_once
from pipeline.fusion.voxel_map import VoxelMap
from pipeline.geo.terrain import Terrain
from pipeline.messages import FloatArray

#: cells that touch, at their corners too, are no farther apart than this many cells
_TOUCHING = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class SalientLocation:
    """A place where a person is likely, or possible.

    id: from 1, in the order of first sight. class_name: what is there. probability: that somebody is there, 0..1:
    by the place's sightings (see ``published``), or by the map's cells where there are none, and by the paper's
    rule. map_probability: mean of the cluster's cells, 0..1. position_enu: float64 (3,), metres, on the terrain.
    latitude_deg, longitude_deg: WGS84. height_m: above the terrain's datum. error: of the position, horizontal.
    spread_m: standard deviation of the sightings' ground points about their mean, horizontal. cells: in the
    cluster. looks: how often it was looked at and seen (see ``sightings``). first_seen_ns, last_seen_ns: capture
    times, ns UTC. streams, setups: who saw it, sorted; a setup is ``MACHINE:DETECTOR`` of the plan. sightings:
    the boxes that it rests on, in their order. people: how many people the sightings show at once, at least 1.
    may_be: ids of the places of which this may be another sight of the same person.
    """

    id: int
    class_name: str
    probability: float
    position_enu: FloatArray
    latitude_deg: float
    longitude_deg: float
    height_m: float
    error: ErrorEllipse
    spread_m: float
    cells: int
    looks: int
    first_seen_ns: int
    last_seen_ns: int
    streams: tuple[str, ...]
    setups: tuple[str, ...] = ()
    sightings: tuple[Look, ...] = ()
    people: int = 1
    may_be: tuple[int, ...] = ()
    map_probability: float | None = None

    @property
    def expected_people(self) -> float:
        """How many people are to be expected there."""
        return self.probability * self.people


@dataclass(frozen=True, eq=False)
class Cluster:
    """probability: 0..1. centers: float64 (N, 3), the middles of its cells, metres. seen_ns: the newest of their looks.
    looks: its sightings, in their order.
    """

    probability: float
    centers: FloatArray
    seen_ns: int
    looks: list[Look]


def salient_locations(
    voxel_map: VoxelMap, looks: Sequence[Look], params: Fusion, class_name: str = "person"
) -> tuple[SalientLocation, ...]:
    """Locations of probability above the threshold, in the order of first sight. looks: of this class.

    Cells closer than the cluster distance, and cells that touch, make one cluster (Euclidean cluster extraction on the
    cells' centres). A look belongs to the cluster of the nearest cell, at most half the cluster distance away, or in
    the cell.
    """
    found = [
        location(voxel_map.terrain, params, class_name, cluster)
        for cluster in _clusters(voxel_map, looks, params)
    ]
    return numbered(found)


def numbered(places: Sequence[SalientLocation]) -> tuple[SalientLocation, ...]:
    """The places in the order of first sight, with ids from 1."""
    ordered = sorted(places, key=lambda place: place.first_seen_ns)
    return tuple(replace(place, id=i) for i, place in enumerate(ordered, start=1))


def locations_of_all_classes(
    maps: Mapping[str, VoxelMap], looks: Sequence[Look], params: Fusion
) -> tuple[SalientLocation, ...]:
    """The salient locations of every class's map, in the order of first sight. maps: by class name."""
    found: list[SalientLocation] = []
    for name, voxel_map in maps.items():
        mine = [look for look in looks if look.class_name == name]
        found += salient_locations(voxel_map, mine, params, name)
    return numbered(found)


def _clusters(voxel_map: VoxelMap, looks: Sequence[Look], params: Fusion) -> list[Cluster]:
    rows, columns, probability = voxel_map.probable(params.threshold)
    if rows.size == 0:
        return []
    cells = np.stack([rows, columns], axis=1)
    centers = voxel_map.terrain.centers(rows, columns)
    count, labels = clustered(cells, centers, params.cluster_distance)
    mine: list[list[Look]] = [[] for _ in range(count)]
    for look, cell in zip(looks, _cell_of(looks, cells, centers, params.cluster_distance / 2.0), strict=True):
        if cell >= 0:
            mine[labels[cell]].append(look)
    p, seen_ns = probability.astype(np.float64), voxel_map.cells_of("last_seen_ns", rows, columns)
    return [
        Cluster(float(p[labels == k].mean()), centers[labels == k], int(seen_ns[labels == k].max()), mine[k])
        for k in range(count)
    ]


def clustered(
    cells: NDArray[np.int64], centers: FloatArray, distance_m: float
) -> tuple[int, NDArray[np.int32]]:
    """Number of clusters and the cluster of each cell: cells (N, 2) that touch, or middles within the distance."""
    near = cKDTree(centers).query_pairs(distance_m, output_type="ndarray")
    touching = cKDTree(cells).query_pairs(_TOUCHING, output_type="ndarray")
    return _connected(len(cells), np.concatenate([near, touching]))


def _connected(count: int, pairs: NDArray[np.int64]) -> tuple[int, NDArray[np.int32]]:
    """Number of groups and the group of each of ``count`` things, of which pairs (M, 2) belong together."""
    links = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    groups, labels = connected_components(links, directed=False)
    return int(groups), labels


def _cell_of(
    looks: Sequence[Look], cells: NDArray[np.int64], centers: FloatArray, reach_m: float
) -> list[int]:
    """For each look the number of the cell that it raised, or else of the nearest within reach; -1: none.

    The cell comes first: by a wall its middle may be far above or below the point where the ray met it.
    """
    if not looks:
        return []
    number = {(row, column): k for k, (row, column) in enumerate(cells.tolist())}
    points = np.array([look.intersection_enu for look in looks])
    _, nearest = cKDTree(centers).query(points, distance_upper_bound=reach_m)
    found = zip(looks, np.asarray(nearest).tolist(), strict=True)
    return [number.get((k.row, k.column), near if near < len(cells) else -1) for k, near in found]


def location(terrain: Terrain, params: Fusion, class_name: str, cluster: Cluster) -> SalientLocation:
    """The place of a cluster, as yet without a number."""
    if not cluster.looks:
        return _of_cells(terrain, class_name, cluster)
    looks = cluster.looks
    middle = mean_intersection(looks)
    east, north = (float(x) for x in locate(looks))
    offsets = np.array([look.intersection_enu for look in looks])[:, :2] - middle[:2]
    times = [look.time_ns for look in looks]
    return _place(
        terrain,
        (east, north, float(middle[2])),
        class_name=class_name,
        probability=cluster.probability if params.update_rule == "paper" else published_probability(looks),
        map_probability=cluster.probability,
        error=ellipse_of(place_covariance(looks, params.uncertainty)),
        spread_m=math.sqrt(float(weights(looks) @ (offsets**2).sum(axis=1))),
        cells=len(cluster.centers),
        looks=count_looks(looks),
        first_seen_ns=min(times),
        last_seen_ns=max(times),
        streams=tuple(sorted({look.stream for look in looks})),
        setups=tuple(sorted({look.detector for look in looks})),
        sightings=tuple(looks),
        people=people_at_once(looks),
    )


def _of_cells(terrain: Terrain, class_name: str, cluster: Cluster) -> SalientLocation:
    """A place that only the map knows of: as sure as its cells are large."""
    east, north, up = (float(x) for x in cluster.centers.mean(axis=0))
    offsets = cluster.centers[:, :2] - (east, north)
    covariance = offsets.T @ offsets / len(offsets) + np.eye(2) * terrain.cell_m**2 / 12.0
    return _place(
        terrain,
        (east, north, up),
        class_name=class_name,
        probability=cluster.probability,
        map_probability=cluster.probability,
        error=ellipse_of(covariance),
        spread_m=0.0,
        cells=len(offsets),
        looks=0,
        first_seen_ns=cluster.seen_ns,
        last_seen_ns=cluster.seen_ns,
        streams=(),
    )


def _place(terrain: Terrain, point: tuple[float, float, float], **known: Any) -> SalientLocation:
    """The place at a point; its height is the terrain's where that is known."""
    east, north, up = point
    height = terrain.height(east, north)
    height = up if math.isnan(height) else height
    latitude, longitude = terrain.frame.wgs84_from_enu(np.array(east), np.array(north))
    return SalientLocation(
        id=0,
        position_enu=np.array([east, north, height]),
        latitude_deg=float(latitude),
        longitude_deg=float(longitude),
        height_m=height,
        **known,
    )
