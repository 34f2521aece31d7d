"""Areas worth a second look: ground where a person may still be, and why.

Negative and positive evidence say where people probably are; how well each place was observed says where the
map does not know. What is worth most comes first: ``worth`` is the expected number of people there, from the mission's
prior, or without one from a density of PRIOR_PER_M2, on ground that was looked at with a probability of detection
(POD), and from the map itself where it is undecided.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import rasterio
import rasterio.features
from numpy.typing import NDArray
from scipy import ndimage

from pipeline.config.fusion import Fusion
from pipeline.config.second_look import SecondLook
from pipeline.fusion.voxel_map import VoxelMap
from pipeline.messages import FloatArray

#: one missing person in a hectare: it orders the areas, nothing else
PRIOR_PER_M2 = 1e-4
#: the reasons, in the order in which one hides the other on the same ground
NOT_REACHED = "never seen: not reached"
HIDDEN = "never seen: hidden behind something"
UNRESOLVED = "undecided"
COARSE = "seen too coarsely"
LOW_POD = "low probability of detection"
FEW_LOOKS = "seen too few times"
REASONS = (NOT_REACHED, HIDDEN, UNRESOLVED, COARSE, LOW_POD, FEW_LOOKS)
#: an undecided cell may belong to a person so far away
_PLACE_RADIUS_M = 1.5

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Layers:
    """What an area is judged by, each (rows, columns), row 0 in the south.

    probability: 0..1, NaN where there is no ground. observations, looks: counts. resolution_px: pixels per
    person. pod: 0..1.
    """

    probability: NDArray[np.float32]
    observations: NDArray[np.int32]
    looks: NDArray[np.int32]
    resolution_px: NDArray[np.float32]
    pod: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class SecondLookArea:
    """id: from 1, the most worth first. reasons: area in square metres by reason. worth: expected people.

    rings: closed outlines of its largest piece, each float64 (N, 2), east and north, metres: the outer,
    counter-clockwise, then the holes; no ring touches itself or another one.
    further: of its other pieces. cells_enu: float64 (M, 2), the middles of the area's cells.
    """

    id: int
    reasons: dict[str, float]
    area_m2: float
    worth: float
    rings: tuple[FloatArray, ...]
    cells_enu: FloatArray
    further: tuple[tuple[FloatArray, ...], ...] = ()

    @property
    def pieces(self) -> tuple[tuple[FloatArray, ...], ...]:
        """The rings of every piece, the largest first."""
        return (self.rings, *self.further)


def layers_of(voxel_map: VoxelMap) -> Layers:
    """The layers of a map."""
    names = ("observations", "looks", "resolution_px", "pod")
    return Layers(voxel_map.probability(), *(voxel_map.layer(name) for name in names))


def second_look_areas(
    layers: Layers,
    searched: Mask,
    corner_m: tuple[float, float],
    cell_m: float,
    fusion: Fusion,
    poa: FloatArray | None = None,
) -> tuple[SecondLookArea, ...]:
    """The areas inside the searched cells (rows, columns), the most worth first.

    corner_m: east and north of the grid's south-west corner. Areas closer than merge_distance are one;
    what is smaller than min_area is left out. poa: the prior of each cell, see ``prior``.
    """
    params = fusion.second_look
    reasons = _reasons(layers, searched, cell_m, fusion)
    wanted = np.any(reasons, axis=0)
    near = _grown(wanted, 0.5 * params.merge_distance / cell_m)
    labels, _ = ndimage.label(near, structure=np.ones((3, 3)))
    areas = []
    for label, window in enumerate(ndimage.find_objects(labels), start=1):
        mine = (labels[window] == label) & wanted[window]
        if mine.sum() * cell_m**2 >= params.min_area:
            corner = np.array(corner_m) + cell_m * np.array([window[1].start, window[0].start])
            parts = _part(layers, window)
            people = PRIOR_PER_M2 * cell_m**2 if poa is None else poa[window][mine]
            areas.append(_area(parts, mine, people, reasons[:, *window], corner, cell_m, params))
    return _numbered(areas)


def _part(layers: Layers, window: tuple[slice, ...]) -> Layers:
    return Layers(*(getattr(layers, field.name)[window] for field in fields(Layers)))


def _area(
    layers: Layers,
    mine: Mask,
    people: float | FloatArray,
    reasons: NDArray[np.bool_],
    corner: FloatArray,
    cell_m: float,
    params: SecondLook,
) -> SecondLookArea:
    """One area, as yet without a number; corner: of the layers' south-west cell. people: expected in each of its
    cells, before anybody looked.
    """
    sizes = (reasons & mine).sum(axis=(1, 2)) * cell_m**2
    undecided = mine & reasons[REASONS.index(UNRESOLVED)]
    unseen = 1.0 - layers.pod[mine]
    missed = people * float(unseen.sum()) if isinstance(people, float) else float((people * unseen).sum())
    chance = float(layers.probability[undecided].max()) if undecided.any() else 0.0
    rows, columns = np.nonzero(mine)
    # the outline is that of the joined pieces, so that one area is one polygon
    pad, radius = _pad(params, cell_m), 0.5 * params.merge_distance / cell_m
    joined = ndimage.binary_closing(np.pad(mine, pad), _disc(radius))
    largest, *further = _outlines(joined, corner - pad * cell_m, cell_m)
    return SecondLookArea(
        0,
        {name: float(size) for name, size in zip(REASONS, sizes, strict=True) if size > 0.0},
        float(mine.sum()) * cell_m**2,
        missed + chance,
        largest,
        corner + (np.stack([columns, rows], axis=1) + 0.5) * cell_m,
        tuple(further),
    )


def _numbered(areas: Sequence[SecondLookArea]) -> tuple[SecondLookArea, ...]:
    ordered = sorted(areas, key=lambda a: (-a.worth, -a.area_m2, *a.cells_enu[0]))
    return tuple(replace(a, id=k) for k, a in enumerate(ordered, start=1))


def _reasons(layers: Layers, searched: Mask, cell_m: float, fusion: Fusion) -> NDArray[np.bool_]:
    """Which cells each of REASONS holds for: (6, rows, columns). A cell has one reason, the first."""
    params = fusion.second_look
    ground = searched & ~np.isnan(layers.probability)
    seen = layers.observations > 0
    enclosed = ndimage.binary_fill_holes(seen)
    p = np.nan_to_num(layers.probability, nan=0.0)
    undecided = seen & (p >= params.unresolved_from) & (p <= fusion.threshold)
    # beside a place that is found, its own undecided edge says nothing new
    found = _grown(seen & (p > fusion.threshold), fusion.cluster_distance / cell_m)
    # evidence, not ignorance: a cell that was hardly looked at is at one half too
    undecided &= ~found & (layers.observations >= params.unresolved_looks)
    masks = [
        ~seen & ~enclosed,
        ~seen & enclosed,
        _grown(undecided, _PLACE_RADIUS_M / cell_m) & ~found if undecided.any() else undecided,
        seen & (layers.resolution_px < params.resolution_min),
        seen & (layers.pod < params.pod_min),
        seen & (layers.looks < params.looks_min),
    ]
    taken = np.zeros_like(seen)
    result = []
    for mask in masks:
        result.append(mask & ground & ~taken)
        taken |= mask
    return np.array(result)


def _pad(params: SecondLook, cell_m: float) -> int:
    return int(np.ceil(0.5 * params.merge_distance / cell_m)) + 1


def _grown(mask: Mask, radius: float) -> Mask:
    """Cells within a radius, in cells, of the mask."""
    if not mask.any() or radius < 1.0:
        return mask
    return np.asarray(ndimage.distance_transform_edt(~mask) <= radius)


def _disc(radius: float) -> Mask:
    reach = int(max(radius, 1.0))
    x, y = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    return np.asarray(np.hypot(x, y) <= max(radius, 1.0))


def _outlines(mask: Mask, corner: FloatArray, cell_m: float) -> list[tuple[FloatArray, ...]]:
    """Rings of every connected piece, the largest first, each the outer one first, in the sense of GeoJSON."""
    mask = _without_pinches(mask)
    transform = rasterio.Affine(cell_m, 0.0, corner[0], 0.0, cell_m, corner[1])
    pieces = rasterio.features.shapes(mask.astype(np.uint8), mask=mask, connectivity=4, transform=transform)
    polygons = [[np.array(ring) for ring in shape["coordinates"]] for shape, _ in pieces]
    polygons.sort(key=lambda polygon: -abs(_signed_area(polygon[0])))
    return [
        tuple(ring if (_signed_area(ring) > 0.0) == (k == 0) else ring[::-1] for k, ring in enumerate(rings))
        for rings in polygons
    ]


def _without_pinches(mask: Mask) -> Mask:
    """The mask and what it takes that no two cells meet at a corner alone: there a ring would touch itself."""
    mask = mask.copy()
    while True:
        nw, ne, sw, se = mask[:-1, :-1], mask[:-1, 1:], mask[1:, :-1], mask[1:, 1:]
        down, up = nw & se & ~ne & ~sw, ne & sw & ~nw & ~se
        if not (down.any() or up.any()):
            return mask
        mask[:-1, :-1] |= up
        mask[:-1, 1:] |= down


def _signed_area(ring: FloatArray) -> float:
    x, y = ring[:, 0], ring[:, 1]
    return float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) / 2.0)
