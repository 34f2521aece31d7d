"""The probability map as a GeoTIFF that every GIS opens."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.transform import from_origin
from rasterio.windows import Window

from pipeline.fusion.voxel_map import VoxelMap
from pipeline.outputs.partial import Partial
from pipeline.storage.versions import stamp
from pipeline.storage.whole_or_nothing import replacing

BANDS = (
    ("probability", "1"),
    ("log_odds", "nat"),
    ("observations", "count"),
    ("looks", "count"),
    ("resolution", "pixels per person"),
    ("pod", "1"),
    ("unseen_for", "s"),
)
BAND_NAMES = [name for name, _ in BANDS]
#: bands that say nothing where nobody looked
_SILENT = [k for k, (_, unit) in enumerate(BANDS) if unit != "count"]
_TILE = 256
#: Cells of a map that is written whole.
MOST_CELLS = 100_000_000


def write_saliency(path: Path, voxel_map: VoxelMap, partial: Partial | None = None) -> None:
    """Write the map, north up, one float32 band for each of BANDS; VoxelMap says what they are.

    Where nobody looked, probability, log_odds, resolution, pod and unseen_for are NaN, the nodata value: no picture
    says anything about that ground, and counts are 0. unseen_for: seconds from when a cell was last seen to the map's
    newest look. In all bands NaN where the terrain is unknown. The CRS is that of the map frame. Counts are exact up
    to 2^24. Of a map of more than MOST_CELLS only the part that was looked at is written. partial: of a run that
    ended too early; its sentence is the tag PARTIAL. The same map gives
    the same bytes.
    """
    rows, columns = _window(voxel_map)
    terrain, newest_ns = voxel_map.terrain, _newest_ns(voxel_map)
    west_m = terrain.east_m + columns.start * terrain.cell_m
    profile = {
        "driver": "GTiff",
        "dtype": "float32",
        "count": len(BANDS),
        "height": rows.stop - rows.start,
        "width": columns.stop - columns.start,
        "crs": terrain.frame.crs.to_wkt(),
        "transform": from_origin(
            west_m, terrain.north_m + rows.stop * terrain.cell_m, terrain.cell_m, terrain.cell_m
        ),
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
        for top in range(0, profile["height"], _TILE):
            strip = slice(max(rows.stop - top - _TILE, rows.start), rows.stop - top)
            bands = _bands(voxel_map, (strip, columns), newest_ns)
            target.write(bands, window=Window(0, top, bands.shape[2], bands.shape[1]))
        tags = {key.upper(): str(value) for key, value in stamp("map").items()}
        target.update_tags(**tags | ({} if partial is None else {"PARTIAL": partial.sentence}))
        target.descriptions = tuple(name for name, _ in BANDS)
        target.units = tuple(unit for _, unit in BANDS)


def _window(voxel_map: VoxelMap) -> tuple[slice, slice]:
    rows, columns = voxel_map.terrain.shape
    if rows * columns > MOST_CELLS and voxel_map.tiles.touched.any():
        return voxel_map.touched_window()
    return slice(0, rows), slice(0, columns)


def _newest_ns(voxel_map: VoxelMap) -> int:
    tiles = voxel_map.tiles
    return max((int(tiles.tile(*tile)["last_seen_ns"].max()) for tile in tiles.touched_tiles()), default=0)


def _bands(voxel_map: VoxelMap, window: tuple[slice, slice], newest_ns: int) -> NDArray[np.float32]:
    """The bands of a part of the map, float32 (bands, rows, columns), row 0 the north edge."""
    names = ("log_odds", "observations", "looks", "resolution_px", "pod")
    seen_ns = voxel_map.layer("last_seen_ns", window)
    unseen_s = np.where(seen_ns == 0, np.nan, (newest_ns - seen_ns) * 1e-9)
    layers = [voxel_map.layer(name, window) for name in names]
    bands = np.stack([voxel_map.probability(window), *layers, unseen_s]).astype(np.float32)
    nobody = bands[BAND_NAMES.index("observations")] == 0
    bands[_SILENT] = np.where(nobody, np.nan, bands[_SILENT])
    bands[:, np.isnan(voxel_map.terrain.heights_m[window])] = np.nan
    return bands[:, ::-1]
