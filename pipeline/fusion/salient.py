"""The places where a person is likely: clusters of probable cells (the paper's sec:extract_salient)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pipeline.config.fusion import Fusion
from pipeline.config.uncertainty import Uncertainty
from pipeline.fusion.error_ellipse import ErrorEllipse, ellipse_of
from pipeline.fusion.error_propagation import place_covariance
from pipeline.fusion.localization import locate, mean_intersection, weights
from pipeline.fusion.look import Look
from pipeline.fusion.voxel_map import VoxelMap
from pipeline.geo.terrain import Terrain
from pipeline.messages import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class SalientLocation:
    """A place where a person is likely.

    id: from 1, in the order of first sight. class_name: what is there. probability: mean of the cluster's
    voxels, 0..1. position_enu: float64 (3,), metres, on the terrain. latitude_deg, longitude_deg: WGS84.
    height_m: above the terrain's datum. error: of the position, horizontal. spread_m: standard deviation of
    the looks' ground points about their mean, horizontal. cells: voxels in the cluster. looks: detections
    that it rests on. first_seen_ns, last_seen_ns: capture times, ns UTC. streams: who saw it, sorted.
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


@dataclass(frozen=True, eq=False)
class _Cluster:
    probability: float
    cells: int
    looks: list[Look]


def salient_locations(
    voxel_map: VoxelMap, looks: Sequence[Look], params: Fusion
) -> tuple[SalientLocation, ...]:
    """Locations of probability above the threshold, in the order of first sight.

    Cells closer than the cluster distance make one cluster (Euclidean cluster extraction on the cells'
    centres). A look belongs to the cluster of the nearest cell, at most half the cluster distance away. A
    cluster without a look is none.
    """
    return tuple(
        _location(voxel_map.terrain, params.uncertainty, i, cluster)
        for i, cluster in enumerate(_seen_clusters(voxel_map, looks, params), start=1)
    )


def looks_by_location(
    voxel_map: VoxelMap, looks: Sequence[Look], params: Fusion
) -> tuple[tuple[Look, ...], ...]:
    """The looks that each of the salient locations rests on, in the order of their ids."""
    return tuple(tuple(cluster.looks) for cluster in _seen_clusters(voxel_map, looks, params))


def _seen_clusters(voxel_map: VoxelMap, looks: Sequence[Look], params: Fusion) -> list[_Cluster]:
    clusters = [cluster for cluster in _clusters(voxel_map, looks, params) if cluster.looks]
    return sorted(clusters, key=lambda cluster: cluster.looks[0].time_ns)


def locations_of_all_classes(
    maps: Mapping[str, VoxelMap], looks: Sequence[Look], params: Fusion
) -> tuple[SalientLocation, ...]:
    """The salient locations of every class's map, in the order of first sight. maps: by class name."""
    found: list[SalientLocation] = []
    for name, voxel_map in maps.items():
        found += salient_locations(voxel_map, [look for look in looks if look.class_name == name], params)
    found.sort(key=lambda location: location.first_seen_ns)
    return tuple(replace(location, id=i) for i, location in enumerate(found, start=1))


def _clusters(voxel_map: VoxelMap, looks: Sequence[Look], params: Fusion) -> list[_Cluster]:
    rows, columns, probability = voxel_map.probable(params.threshold)
    if rows.size == 0:
        return []
    tree = cKDTree(voxel_map.terrain.centers(rows, columns))
    count, labels = _euclidean_clusters(tree, params.cluster_distance)
    mine = _looks_of(tree, labels, count, looks, params.cluster_distance / 2.0)
    p = probability.astype(np.float64)
    return [_Cluster(float(p[labels == k].mean()), int((labels == k).sum()), mine[k]) for k in range(count)]


def _euclidean_clusters(tree: cKDTree, distance_m: float) -> tuple[int, NDArray[np.int32]]:
    """Number of clusters and the cluster of each point; points within the distance are together."""
    pairs = tree.query_pairs(distance_m, output_type="ndarray")
    links = coo_array(
        (np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(tree.n, tree.n)
    )
    count, labels = connected_components(links, directed=False)
    return int(count), labels


def _looks_of(
    tree: cKDTree, labels: NDArray[np.int32], count: int, looks: Sequence[Look], reach_m: float
) -> list[list[Look]]:
    """The looks of each cluster, in their order."""
    found: list[list[Look]] = [[] for _ in range(count)]
    if looks:
        _, nearest = tree.query(
            np.array([look.intersection_enu for look in looks]), distance_upper_bound=reach_m
        )
        for look, point in zip(looks, np.asarray(nearest).tolist(), strict=True):
            if point < tree.n:
                found[labels[point]].append(look)
    return found


def _location(terrain: Terrain, uncertainty: Uncertainty, number: int, cluster: _Cluster) -> SalientLocation:
    looks = cluster.looks
    middle = mean_intersection(looks)
    east, north = (float(x) for x in locate(looks))
    height = terrain.height(east, north)
    if math.isnan(height):
        height = float(middle[2])
    latitude, longitude = terrain.frame.wgs84_from_enu(np.array(east), np.array(north))
    offsets = np.array([look.intersection_enu for look in looks])[:, :2] - middle[:2]
    return SalientLocation(
        id=number,
        class_name=looks[0].class_name,
        probability=cluster.probability,
        position_enu=np.array([east, north, height]),
        latitude_deg=float(latitude),
        longitude_deg=float(longitude),
        height_m=height,
        error=ellipse_of(place_covariance(looks, uncertainty)),
        spread_m=math.sqrt(float(weights(looks) @ (offsets**2).sum(axis=1))),
        cells=cluster.cells,
        looks=len(looks),
        first_seen_ns=min(look.time_ns for look in looks),
        last_seen_ns=max(look.time_ns for look in looks),
        streams=tuple(sorted({look.stream for look in looks})),
    )
