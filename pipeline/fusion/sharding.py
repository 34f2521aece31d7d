"""One map from several fusers, each of which keeps some of the tiles.

Every fuser is given every result, in the same order: each works out what the frame sees unless none of its
tiles is within reach, and writes to its own tiles only. So every tile is the same as that of one fuser, and
their union is the whole map.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.fusion.fuser import Fuser
from pipeline.fusion.tiles import tile_shape


def shares(shape: tuple[int, int], fusers: int) -> list[NDArray[np.bool_]]:
    """The tiles of each fuser, bool (tile rows, tile columns), for a grid of so many rows and columns.

    Each gets a strip from west to east, so that few frames lie in two; a strip's edge may be within a column.
    """
    rows, columns = tile_shape(shape)
    owner = (np.arange(rows * columns) * fusers // (rows * columns)).reshape(columns, rows).T
    return [owner == k for k in range(fusers)]


def merge(fusers: Sequence[Fuser], into: Fuser) -> None:
    """Gather what several fusers know in another one that keeps all tiles and knows nothing yet.

    All of them have seen every result, so their counts are the same.
    """
    for name, whole in into.maps.items():
        for fuser in fusers:
            part = fuser.maps[name].tiles
            for tile in part.touched_tiles():
                whole.tiles.tile(*tile)[:] = part.tile(*tile)
                whole.tiles.touched[tile] = True
    into.looks[:] = sorted((look for fuser in fusers for look in fuser.looks), key=lambda look: look.order)
    into.refused, into.unplaced = fusers[0].refused.copy(), fusers[0].unplaced.copy()
    into.sizes, into.last_ns = fusers[0].sizes.copy(), fusers[0].last_ns.copy()
    into.viewpoints.newest = dict(fusers[0].viewpoints.newest)
