"""The map as it is shown: probability and POD in a byte each, coarse enough for a screen."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray

from pipeline.fusion.voxel_map import VoxelMap
from pipeline.messages import FloatArray

#: cells on the longer side
MOST_SIDE = 1500
#: a byte is 1 + STEPS * value; 0: nobody looked
STEPS = 254


@dataclass(frozen=True, eq=False)
class Layer:
    """probability, pod: uint8 (rows, columns), row 0 in the south; 0: nobody looked, else 1 + 254 p. east_m, north_m:
    of the south-west corner in the map frame. cell_m: side of a cell.

    Where cells of the map were put together, probability is that of the likeliest, pod the mean with 0 where nobody
    looked, and nobody looked only if nobody looked at any.
    """

    east_m: float
    north_m: float
    cell_m: float
    probability: NDArray[np.uint8]
    pod: NDArray[np.uint8]

    def encoded(self) -> bytes:
        """As a file."""
        buffer = io.BytesIO()
        place = np.array([self.east_m, self.north_m, self.cell_m])
        np.savez(buffer, place=place, probability=self.probability, pod=self.pod)
        return buffer.getvalue()

    @classmethod
    def decoded(cls, data: bytes) -> Layer:
        """Of a file."""
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            east, north, cell = file["place"].tolist()
            return cls(east, north, cell, file["probability"], file["pod"])


def layer_of(voxel_map: VoxelMap) -> Layer:
    """Of the part of a map that anything is known of."""
    window = voxel_map.touched_window()
    looked = voxel_map.layer("observations", window) > 0
    terrain = voxel_map.terrain
    return _layer(
        terrain.east_m + window[1].start * terrain.cell_m,
        terrain.north_m + window[0].start * terrain.cell_m,
        terrain.cell_m,
        np.where(looked, voxel_map.probability(window), np.nan),
        np.where(looked, voxel_map.layer("pod", window), np.nan),
    )


def layer_of_tif(path: Path) -> Layer:
    """Of ``saliency.tif``."""
    with rasterio.open(path) as file:
        names = list(file.descriptions)
        probability = file.read(names.index("probability") + 1)[::-1]
        pod = file.read(names.index("pod") + 1)[::-1]
        cell, west, north = file.transform.a, file.transform.c, file.transform.f
    return _layer(west, north - cell * probability.shape[0], cell, probability, pod)


def _layer(east_m: float, north_m: float, cell_m: float, probability: FloatArray, pod: FloatArray) -> Layer:
    """Of values that are NaN where nobody looked."""
    side = max(1, -(-max(probability.shape, default=1) // MOST_SIDE))
    looked = np.isfinite(probability)
    best = _blocks(np.where(looked, probability, -1.0), side, -1.0).max(axis=(1, 3))
    mean = _blocks(np.where(looked, pod, 0.0), side, 0.0).mean(axis=(1, 3))
    nobody = best < 0.0
    return Layer(east_m, north_m, cell_m * side, _bytes(best, nobody), _bytes(mean, nobody))


def _blocks(values: FloatArray, side: int, beyond: float) -> FloatArray:
    rows, columns = (-(-n // side) * side for n in values.shape)
    wide = np.full((rows, columns), beyond, dtype=np.float32)
    wide[: values.shape[0], : values.shape[1]] = values
    return wide.reshape(rows // side, side, columns // side, side)


def _bytes(values: FloatArray, nobody: NDArray[np.bool_]) -> NDArray[np.uint8]:
    coded = 1.0 + np.round(STEPS * np.clip(values, 0.0, 1.0))
    return np.where(nobody, 0.0, coded).astype(np.uint8)
