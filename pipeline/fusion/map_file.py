"""A map as a file: every touched tile, so that a search can go on later."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import msgpack
import numpy as np

from pipeline.errors import InputError
from pipeline.fusion.tiles import TILE
from pipeline.fusion.voxel_map import VOXEL, VoxelMap
from pipeline.storage.checksummed import read_records, write_records

KIND = "searchlight map 1"


def save_map(path: Path, voxel_map: VoxelMap) -> None:
    """Write the map; until all of it is on the disk, path stays as it was. Same map, same bytes."""
    write_records(path, KIND, map_records(voxel_map))


def load_map(path: Path, voxel_map: VoxelMap) -> None:
    """Replace what is known of every voxel by what a file says.

    Raises InputError, and leaves the map as it was, if the file is damaged or of another grid.
    """
    restore_map(path, voxel_map, read_records(path, KIND))


def map_records(voxel_map: VoxelMap) -> Iterator[bytes]:
    """The map as records: the grid, then the touched tiles."""
    yield msgpack.packb(_grid(voxel_map) | {"tiles": int(voxel_map.tiles.touched.sum())})
    for tile in voxel_map.tiles.touched_tiles():
        packed = zlib.compress(voxel_map.tiles.tile(*tile).tobytes(), 1)
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


def _grid(voxel_map: VoxelMap) -> dict[str, Any]:
    terrain = voxel_map.terrain
    return {
        "shape": list(terrain.shape),
        "cell_m": terrain.cell_m,
        "corner_m": [terrain.east_m, terrain.north_m],
        "origin_deg": [terrain.frame.origin_latitude_deg, terrain.frame.origin_longitude_deg],
        "limits": list(voxel_map.limits),
    }
