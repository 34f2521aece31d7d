"""A map as a file: every touched tile, so that a search can go on later."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.fusion.tiles import TILE, TILE_BITS, Before
from pipeline.fusion.voxel_map import VOXEL, VoxelMap
from pipeline.storage.checksummed import read_records, write_records

KIND = "searchlight map 2"
#: corners of grids that share their cells are whole cells apart, to this share of one
_SAME_LATTICE = 1e-4
NOTHING_BEFORE: Before = {}


def save_map(path: Path, voxel_map: VoxelMap) -> None:
    """Write the map; until all of it is on the disk, path stays as it was. Same map, same bytes."""
    write_records(path, KIND, map_records(voxel_map))


def load_map(path: Path, voxel_map: VoxelMap) -> None:
    """Replace what is known of every voxel by what a file says.

    Raises InputError, and leaves the map as it was, if the file is damaged or of another grid.
    """
    restore_map(path, voxel_map, read_records(path, KIND))


def map_records(voxel_map: VoxelMap, before: Before = NOTHING_BEFORE) -> Iterator[bytes]:
    """The map as records: the grid, then the touched tiles. before: tiles that are to be as they were."""
    tiles = voxel_map.tiles
    known = [tile for tile in tiles.touched_tiles() if tile not in before or before[tile] is not None]
    yield msgpack.packb(_grid(voxel_map) | {"tiles": len(known)})
    for tile in known:
        records = before.get(tile)
        packed = zlib.compress((tiles.tile(*tile) if records is None else records).tobytes(), 1)
        yield msgpack.packb([*tile, packed])


def restore_map(path: Path, voxel_map: VoxelMap, records: Iterable[bytes]) -> None:
    """The inverse of map_records; takes as many records as it needs. path: for the error."""
    rest = iter(records)
    header = msgpack.unpackb(next(rest))
    for name, mine in _grid(voxel_map).items():
        if header[name] != mine:
            raise InputError(f"{path} {name}", repr(header[name]), f"{mine!r}, as this mission's")
    voxel_map.tiles.clear()
    for _ in range(header["tiles"]):
        row, column, packed = msgpack.unpackb(next(rest))
        if voxel_map.tiles.owned[row, column]:
            cells = np.frombuffer(zlib.decompress(packed), dtype=VOXEL)
            voxel_map.tiles.tile(row, column)[:] = cells.reshape(TILE, TILE)
            voxel_map.tiles.touched[row, column] = True


@dataclass(frozen=True, eq=False)
class StoredMap:
    """A map without its terrain. grid: as ``_grid`` says it. tiles: row, column and packed cells of those touched."""

    grid: Mapping[str, Any]
    tiles: tuple[tuple[int, int, bytes], ...]


def stored_map(records: Iterable[bytes]) -> StoredMap:
    """The next map in records that map_records made; takes as many as it needs."""
    rest = iter(records)
    grid = msgpack.unpackb(next(rest))
    return StoredMap(grid, tuple(tuple(msgpack.unpackb(next(rest))) for _ in range(grid["tiles"])))


def shift_of(where: object, stored: StoredMap, voxel_map: VoxelMap) -> tuple[int, int]:
    """Rows and columns by which a stored map lies north and east of another one's corner.

    where: what the stored map is, for the error. Raises InputError unless their cells, frames and limits are the same
    and every cell that is known lies on the other's terrain.
    """
    mine = _grid(voxel_map)
    for name, say in (("cell_m", "fusion.cell_size"), ("limits", "fusion.clamp_min and clamp_max")):
        if stored.grid[name] != mine[name]:
            raise InputError(f"{where} {say}", str(stored.grid[name]), f"{mine[name]}, as this mission's")
    if stored.grid["origin_deg"] != mine["origin_deg"]:
        expected = f"{mine['origin_deg']}, as this mission's: the middle of its surface model"
        raise InputError(f"{where} origin of the map frame", str(stored.grid["origin_deg"]), expected)
    shift = [
        (theirs - ours) / mine["cell_m"]
        for theirs, ours in zip(stored.grid["corner_m"], mine["corner_m"], strict=True)
    ]
    columns, rows = (round(s) for s in shift)
    if abs(shift[0] - columns) > _SAME_LATTICE or abs(shift[1] - rows) > _SAME_LATTICE:
        raise InputError(
            f"{where} corner of the map", str(stored.grid["corner_m"]), "whole cells from this map's"
        )
    for tile in _parts(stored, (rows, columns)):
        if tile.beyond(mine["shape"]):
            raise InputError(
                str(where),
                "a map that reaches beyond this mission's terrain",
                "a terrain that holds all of it",
            )
    return rows, columns


def add_stored(stored: StoredMap, shift: tuple[int, int], voxel_map: VoxelMap) -> None:
    """Put the known cells of a stored map in their place; shift: of ``shift_of``. Other cells stay as they are."""
    tiles = voxel_map.tiles
    for part in _parts(stored, shift):
        rows, columns = np.nonzero(part.known)
        if len(rows):
            at = rows + part.row, columns + part.column
            mine = tiles.owned[at[0] >> TILE_BITS, at[1] >> TILE_BITS]
            at = at[0][mine], at[1][mine]
            tiles.touch(*at)
            tiles.cells[tiles.flat(*at)] = part.cells[rows[mine], columns[mine]]


@dataclass(frozen=True, eq=False)
class _Part:
    """The cells (TILE, TILE) of a stored tile; row, column: of its first one in the other grid."""

    row: int
    column: int
    cells: NDArray[Any]

    @property
    def known(self) -> NDArray[np.bool_]:
        return np.asarray((self.cells["observations"] > 0) | (self.cells["looks"] > 0))

    def beyond(self, shape: Sequence[int]) -> bool:
        """Whether a known cell is off a grid."""
        rows, columns = np.nonzero(self.known)
        rows, columns = rows + self.row, columns + self.column
        return bool(np.any((rows < 0) | (rows >= shape[0]) | (columns < 0) | (columns >= shape[1])))


def _parts(stored: StoredMap, shift: tuple[int, int]) -> Iterator[_Part]:
    for row, column, packed in stored.tiles:
        cells = np.frombuffer(zlib.decompress(packed), dtype=VOXEL).reshape(TILE, TILE)
        yield _Part(row * TILE + shift[0], column * TILE + shift[1], cells)


def _grid(voxel_map: VoxelMap) -> dict[str, Any]:
    terrain = voxel_map.terrain
    return {
        "shape": list(terrain.shape),
        "cell_m": terrain.cell_m,
        "corner_m": [terrain.east_m, terrain.north_m],
        "origin_deg": [terrain.frame.origin_latitude_deg, terrain.frame.origin_longitude_deg],
        "limits": list(voxel_map.limits),
    }
