"""Possible places: where the map is below the threshold, but something was detected again and again.

A map that is not sure says so. What stays here are the sightings that no found place rests on: those in cells closer
than the cluster distance make a group, and a group of enough frames is a possible place, unless it may be the person
of a found place. A group whose boxes are right with a probability of at least the threshold is found, whatever the map
says: the map is lowered by every frame that missed it. Not so a group that is spread out, which may be the way of
somebody who walks, nor by the paper's rule.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pipeline.config.fusion import Fusion
from pipeline.fusion.look import Look
from pipeline.fusion.one_person import may_be_one, with_may_be
from pipeline.fusion.salient import (
    Cluster,
    SalientLocation,
    clustered,
    location,
    locations_of_all_classes,
    numbered,
)
from pipeline.fusion.sightings import count_frames
from pipeline.fusion.voxel_map import VoxelMap


def found_and_possible(
    maps: Mapping[str, VoxelMap], looks: Sequence[Look], params: Fusion
) -> tuple[tuple[SalientLocation, ...], tuple[SalientLocation, ...]]:
    """The places above the threshold in the order of first sight, and the possible ones, the most probable first.

    maps: by class name. Ids go on from the found places to the possible ones.
    """
    found = with_may_be(locations_of_all_classes(maps, looks, params), params.uncertainty)
    taken = {id(sighting) for place in found for sighting in place.sightings}
    possible: list[SalientLocation] = []
    for name, voxel_map in maps.items():
        left = [look for look in looks if look.class_name == name and id(look) not in taken]
        possible += _groups(voxel_map, left, params, name)
    apart = [
        place
        for place in possible
        if not any(may_be_one(place, other, params.uncertainty) for other in found)
    ]
    sure = [place for place in apart if _is_sure(place, params)]
    if sure:
        found = with_may_be(_in_order([*found, *sure]), params.uncertainty)
        apart = [place for place in apart if not _is_sure(place, params)]
    apart.sort(key=lambda place: (-place.probability, -len(place.sightings), place.first_seen_ns))
    ids = range(len(found) + 1, len(found) + len(apart) + 1)
    return found, tuple(replace(place, id=i) for i, place in zip(ids, apart, strict=True))


def _is_sure(place: SalientLocation, params: Fusion) -> bool:
    """Whether a possible place is found by its boxes alone."""
    together = place.spread_m <= params.cluster_distance
    return params.update_rule != "paper" and together and place.probability >= params.threshold


def _in_order(places: list[SalientLocation]) -> tuple[SalientLocation, ...]:
    return numbered([replace(place, may_be=()) for place in places])


def _groups(
    voxel_map: VoxelMap, looks: Sequence[Look], params: Fusion, class_name: str
) -> list[SalientLocation]:
    if not looks:
        return []
    # cells, not sightings: a stone may be taken for a person ten thousand times
    cells, cell_of = np.unique(np.array([(k.row, k.column) for k in looks]), axis=0, return_inverse=True)
    count, labels = clustered(cells, voxel_map.terrain.centers(*cells.T), params.cluster_distance)
    groups: list[list[Look]] = [[] for _ in range(count)]
    for look, cell in zip(looks, np.ravel(cell_of).tolist(), strict=True):
        groups[labels[cell]].append(look)
    return [
        location(voxel_map.terrain, params, class_name, _cluster(voxel_map, group))
        for group in groups
        if count_frames(group) >= params.possible_frames
    ]


def _cluster(voxel_map: VoxelMap, looks: list[Look]) -> Cluster:
    """probability: of the likeliest cell that the looks raised."""
    cells = np.unique(np.array([(look.row, look.column) for look in looks]), axis=0)
    rows, columns = cells.T
    log_odds = voxel_map.cells_of("log_odds", rows, columns)
    probability = float((1.0 / (1.0 + np.exp(-log_odds.astype(np.float64)))).max())
    newest_ns = max(look.time_ns for look in looks)
    return Cluster(probability, voxel_map.terrain.centers(rows, columns), newest_ns, looks)
