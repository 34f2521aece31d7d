"""The ground as it is shown: heights on a coarse grid, and what is to be searched."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.geo.frame import LocalFrame
from pipeline.geo.terrain import Terrain
from pipeline.messages import FloatArray

#: cells on the longer side
MOST_SIDE = 1000


@dataclass(frozen=True, eq=False)
class Ground:
    """heights_m: float32 (rows, columns), row 0 in the south, NaN where unknown, of every so many-th cell.
    east_m, north_m: of the south-west corner. area: rings (N, 2) of the search area, east and north, metres.
    """

    frame: LocalFrame
    east_m: float
    north_m: float
    cell_m: float
    heights_m: NDArray[np.float32]
    area: Sequence[FloatArray] = ()

    def heights_at(self, east_m: FloatArray, north_m: FloatArray) -> FloatArray:
        """Heights (any shape) of the nearest cells; NaN outside."""
        columns = np.floor((east_m - self.east_m) / self.cell_m)
        rows = np.floor((north_m - self.north_m) / self.cell_m)
        inside = (
            (rows >= 0)
            & (rows < self.heights_m.shape[0])
            & (columns >= 0)
            & (columns < self.heights_m.shape[1])
        )
        picked = self.heights_m[
            np.where(inside, rows, 0).astype(int), np.where(inside, columns, 0).astype(int)
        ]
        return np.where(inside, picked, np.nan).astype(np.float64)

    def encoded(self) -> bytes:
        """As a file."""
        buffer = io.BytesIO()
        head = {
            "origin": [self.frame.origin_latitude_deg, self.frame.origin_longitude_deg],
            "place": [self.east_m, self.north_m, self.cell_m],
            "area": [ring.tolist() for ring in self.area],
        }
        np.savez_compressed(buffer, head=np.array(json.dumps(head)), heights=self.heights_m)
        return buffer.getvalue()

    @classmethod
    def decoded(cls, data: bytes) -> Ground:
        """Of a file."""
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            head = json.loads(str(file["head"]))
            heights = file["heights"]
        area = tuple(np.array(ring, dtype=np.float64).reshape(-1, 2) for ring in head["area"])
        east_m, north_m, cell_m = head["place"]
        return cls(LocalFrame(*head["origin"]), east_m, north_m, cell_m, heights, area)


def ground_of(terrain: Terrain, area: Sequence[FloatArray] = ()) -> Ground:
    """A terrain, every so many-th cell of it."""
    step = max(1, -(-max(terrain.shape) // MOST_SIDE))
    first = step // 2
    heights = np.array(terrain.heights_m[first::step, first::step], dtype=np.float32)
    return Ground(terrain.frame, terrain.east_m, terrain.north_m, terrain.cell_m * step, heights, tuple(area))
