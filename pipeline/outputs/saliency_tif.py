"""The probability map as a GeoTIFF that every GIS opens."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.transform import from_origin

from pipeline.fusion.voxel_map import VoxelMap
from pipeline.outputs.safe_write import replacing

BANDS = (
    ("probability", "1"),
    ("log_odds", "nat"),
    ("observations", "count"),
    ("looks", "count"),
    ("resolution", "pixels per person"),
    ("pod", "1"),
    ("unseen_for", "s"),
)
_TILE = 256


def write_saliency(path: Path, voxel_map: VoxelMap) -> None:
    """Write the map, north up, one float32 band for each of BANDS; VoxelMap says what they are.

    unseen_for: seconds from when a cell was last seen to the map's newest look; NaN: never seen. In all bands NaN (the nodata value) where the terrain is unknown. The CRS is that of the map frame. Observations are
    whole numbers, exact up to 2^24. The same map gives the same bytes.
    """
    bands = saliency_bands(voxel_map)
    terrain = voxel_map.terrain
    north_edge_m = terrain.north_m + terrain.shape[0] * terrain.cell_m
    profile = {
        "driver": "GTiff",
        "dtype": "float32",
        "count": len(BANDS),
        "height": terrain.shape[0],
        "width": terrain.shape[1],
        "crs": terrain.frame.crs.to_wkt(),
        "transform": from_origin(terrain.east_m, north_edge_m, terrain.cell_m, terrain.cell_m),
        "nodata": np.nan,
        "tiled": True,
        "blockxsize": _TILE,
        "blockysize": _TILE,
        "interleave": "band",
        "compress": "deflate",
        "predictor": 3,
        "bigtiff": "if_safer",
    }
    with replacing(path) as temporary, rasterio.open(temporary, "w", **profile) as target:
        target.write(bands)
        target.descriptions = tuple(name for name, _ in BANDS)
        target.units = tuple(unit for _, unit in BANDS)


def saliency_bands(voxel_map: VoxelMap) -> NDArray[np.float32]:
    """The bands, float32 (bands, rows, columns), row 0 the north edge."""
    seen_ns = voxel_map.last_seen_ns
    unseen_s = np.where(seen_ns == 0, np.nan, (seen_ns.max() - seen_ns) * 1e-9)
    layers = [voxel_map.log_odds, voxel_map.observations, voxel_map.looks, voxel_map.resolution_px]
    bands = np.stack([voxel_map.probability(), *layers, voxel_map.pod, unseen_s]).astype(np.float32)
    bands[:, np.isnan(voxel_map.terrain.heights_m)] = np.nan
    return bands[:, ::-1]
