"""The map: log-odds that a person is there, one voxel per cell of the terrain's surface."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.fusion.voxel_map_kernels import add_clamped
from pipeline.geo.terrain import Terrain
from pipeline.messages import FloatArray

#: Probabilities are kept this far from 0 and 1, so that every log-odds is finite.
_CERTAINTY = 1e-9


def log_odds(probability: FloatArray) -> FloatArray:
    """L = log(p / (1 - p)) of probabilities in 0..1, any shape; finite at 0 and 1."""
    p = np.clip(probability, _CERTAINTY, 1.0 - _CERTAINTY)
    return np.asarray(np.log(p / (1.0 - p)), dtype=np.float64)


class VoxelMap:
    """Evidence on the surface cells of a terrain; OctoMap's additive update with clamping.

    log_odds: float32 (rows, columns), 0 where nothing is known. observations: int32 (rows, columns), number
    of updates. The result of a series of updates depends on their order, because each is clamped.
    """

    def __init__(self, terrain: Terrain, clamp_min: float, clamp_max: float) -> None:
        """clamp_min, clamp_max: least, greatest probability of a voxel; InputError unless 0.5 is between."""
        if not 0.0 <= clamp_min < 0.5 < clamp_max <= 1.0:
            raise InputError(
                "fusion.clamp_min, clamp_max", f"{clamp_min:g} and {clamp_max:g}", "0 <= min < 0.5 < max <= 1"
            )
        self.terrain = terrain
        self.log_odds = np.zeros(terrain.shape, dtype=np.float32)
        self.observations = np.zeros(terrain.shape, dtype=np.int32)
        low, high = log_odds(np.array([clamp_min, clamp_max]))
        self._low, self._high = float(low), float(high)

    def valid(self, row: int, column: int) -> bool:
        """Whether there is a voxel: a cell of the terrain whose height is known."""
        rows, columns = self.terrain.shape
        inside = 0 <= row < rows and 0 <= column < columns
        return inside and math.isfinite(self.terrain.heights_m[row, column])

    def update(self, rows: NDArray[np.int64], columns: NDArray[np.int64], delta: FloatArray) -> None:
        """L(n|z_1:t) = L(n|z_1:t-1) + L(n|z_t), clamped (eq:voxelloupdate).

        rows, columns: int64 (N,), valid cells. delta: float64 (N,) log-odds. A cell named twice is updated
        twice, in order.
        """
        add_clamped(self.log_odds, self.observations, rows, columns, delta, self._low, self._high)

    def probability(self) -> NDArray[np.float32]:
        """float32 (rows, columns) in 0..1; 0.5 where nothing is known, NaN where there is no voxel."""
        known = 1.0 / (1.0 + np.exp(-self.log_odds))
        return np.where(np.isfinite(self.terrain.heights_m), known, np.float32(np.nan)).astype(np.float32)
