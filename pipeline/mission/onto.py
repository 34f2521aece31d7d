"""A run whose map goes on with another flight (``searchlight run MISSION --onto RUN``).

A run directory keeps its state in STATE_FILE: the maps, the sightings, the accounts, the ways and the pictures of
places. Another mission's fuser begins with them. The streams of flight k are called NAME#k from then on: what all looks
of a stream share, such as the offset of its positions, is shared within one flight only.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import msgpack
import numpy as np

from pipeline.config.fusion import Fusion
from pipeline.errors import InputError
from pipeline.fusion.fuser import Fuser
from pipeline.fusion.look import Look
from pipeline.fusion.map_file import StoredMap, add_stored, shift_of, stored_map
from pipeline.fusion.voxel_map import LOOK_GAP_NS, VoxelMap
from pipeline.geo.frame import LocalFrame
from pipeline.geo.heights import Heights
from pipeline.ingest.ground import GroundModel, Window
from pipeline.messages import FloatArray
from pipeline.mission.stages.source import StreamInput
from pipeline.outputs.earlier_flight import EarlierFlight, flight_from_json
from pipeline.storage.checksummed import read_records

STATE_FILE = "map.state"
KIND = "searchlight run 2"
LOOK_FIELDS = [field.name for field in fields(Look)]
#: frames whose origins are this near are the same, degrees: a hundredth of a millimetre
_SAME_ORIGIN_DEG = 1e-10


@dataclass(frozen=True, eq=False)
class EarlierRun:
    """path: of its state. maps: by class. looks: its sightings. heights: what the map's count from.

    flights: one after the other. tracks: positions of each drone, float64 (N, 3). crops: pictures by the order of a
    sighting.
    """

    path: Path
    maps: Mapping[str, StoredMap]
    looks: tuple[Look, ...]
    heights: Heights
    flights: tuple[EarlierFlight, ...]
    tracks: Mapping[str, FloatArray]
    crops: Mapping[tuple[int, str, str, int], bytes]

    @property
    def _grid(self) -> Mapping[str, Any]:
        return next(iter(self.maps.values())).grid

    @property
    def frame(self) -> LocalFrame:
        """Of its map."""
        return LocalFrame(*self._grid["origin_deg"])

    @property
    def window(self) -> Window:
        """The part of the frame that its map covers."""
        (west, south), (rows, columns), cell_m = (self._grid[k] for k in ("corner_m", "shape", "cell_m"))
        return west, south, west + columns * cell_m, south + rows * cell_m


def read_earlier_run(folder: Path) -> EarlierRun:
    """What a run directory keeps. Raises InputError if it is none, or keeps nothing, or is damaged."""
    path = folder / STATE_FILE
    if not path.is_file():
        raise InputError(folder, f"no {STATE_FILE}", "the directory of a run of this version")
    records = read_records(path, KIND)
    state = msgpack.unpackb(next(records), strict_map_key=False, use_list=False)
    if list(state["look_fields"]) != LOOK_FIELDS:
        raise InputError(path, "sightings of another version", "the directory of a run of this version")
    maps = {name: stored_map(records) for name in state["classes"]}
    return EarlierRun(
        path,
        maps,
        tuple(_look(values) for values in state["looks"]),
        Heights(state["height_datum"]),
        tuple(flight_from_json(values) for values in state["flights"]),
        {name: np.frombuffer(data).reshape(-1, 3) for name, data in state["tracks"]},
        dict(state["crops"]),
    )


def require_fits(onto: EarlierRun, fusion: Fusion, frame: LocalFrame) -> None:
    """Raises InputError unless the map's cells, frame and classes are those of a mission."""
    theirs, mine = onto.frame, frame
    apart_deg = max(
        abs(theirs.origin_latitude_deg - mine.origin_latitude_deg),
        abs(theirs.origin_longitude_deg - mine.origin_longitude_deg),
    )
    if apart_deg > _SAME_ORIGIN_DEG:
        found = f"a map about {theirs.origin_latitude_deg:.6f}, {theirs.origin_longitude_deg:.6f}"
        expected = (
            f"one about {mine.origin_latitude_deg:.6f}, {mine.origin_longitude_deg:.6f}, "
            "the middle of this mission's surface model: the same terrain.file"
        )
        raise InputError(onto.path, found, expected)
    cell_m = onto._grid["cell_m"]
    if cell_m != fusion.cell_size:
        expected = f"cells of {fusion.cell_size:g} m, as this mission's fusion.cell_size"
        raise InputError(onto.path, f"a map in cells of {cell_m:g} m", expected)
    classes = tuple(c.name for c in fusion.classes)
    if tuple(onto.maps) != classes:
        raise InputError(
            onto.path, f"layers {', '.join(onto.maps)}", f"{', '.join(classes)}, as this mission's"
        )


def require_continues(
    onto: EarlierRun, fusion: Fusion, ground: GroundModel, streams: Sequence[StreamInput]
) -> None:
    """Raises InputError unless the map can go on over a terrain, with flights that it does not hold yet."""
    if onto.heights.datum != ground.heights.datum:
        found, expected = (
            f"heights above: {onto.heights.name}",
            f"{ground.heights.name}, as this mission's terrain",
        )
        raise InputError(onto.path, found, expected)
    scratch = VoxelMap(ground.terrain, fusion.clamp_min, fusion.clamp_max)
    for stored in onto.maps.values():
        shift_of(onto.path, stored, scratch)
    for stream in streams:
        for flight in onto.flights:
            if fingerprint(stream) in flight.fingerprints:
                found = f"the flight of {stream.stream} already, as flight {flight.number}: {flight.mission}"
                raise InputError(onto.path, found, "another flight: the same evidence would count twice")


def joined(window: Window | None, other: Window) -> Window:
    """The least window that holds both."""
    if window is None:
        return other
    return (
        min(window[0], other[0]),
        min(window[1], other[1]),
        max(window[2], other[2]),
        max(window[3], other[3]),
    )


def fingerprint(stream: StreamInput) -> str:
    """Of the way of a stream's camera, to the millimetre: the same for the same recording only."""
    trajectory, digest = stream.trajectory, hashlib.sha256()
    for values in (trajectory.times_s, trajectory.positions_enu, trajectory.angles_rad):
        digest.update(np.round(1000.0 * values).astype(np.int64).tobytes())
    digest.update(str(trajectory.start_ns // 1_000_000).encode("ascii"))
    return digest.hexdigest()


def go_on(fuser: Fuser, onto: EarlierRun, start_ns: int) -> None:
    """Let a new fuser begin with what an earlier run knows. start_ns: of the new flight's first picture.

    A look ends with its flight: the next frame of a place begins another one, whatever the clocks say.
    """
    for name, stored in onto.maps.items():
        voxel_map = fuser.maps[name]
        add_stored(stored, shift_of(onto.path, stored, voxel_map), voxel_map)
        voxel_map.end_looks()
        for tile in voxel_map.tiles.touched_tiles():
            cells = voxel_map.tiles.tile(*tile)
            seen = cells["looks"] > 0
            latest_ns = np.minimum(cells["last_seen_ns"], start_ns - LOOK_GAP_NS - 1)
            cells["last_seen_ns"] = np.where(seen, latest_ns, 0)
    cells_of = _rows_and_columns(fuser, onto)
    fuser.looks[:] = [
        replace(look, row=row, column=column)
        for look, (row, column) in zip(onto.looks, cells_of, strict=True)
    ]


def _rows_and_columns(fuser: Fuser, onto: EarlierRun) -> list[tuple[int, int]]:
    """Where the sightings' cells lie in the new map, which may begin farther south or west."""
    first = next(iter(onto.maps.values()))
    rows, columns = shift_of(onto.path, first, fuser.map)
    return [(look.row + rows, look.column + columns) for look in onto.looks]


def _look(values: tuple[Any, ...]) -> Look:
    arguments: list[Any] = [np.array(v) if isinstance(v, tuple) else v for v in values]
    return Look(*arguments)
