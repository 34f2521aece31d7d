"""Where people are hidden from the air: canopy and undergrowth, polygons or a raster, in the cells of a terrain."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from rasterio.features import rasterize
from rasterio.transform import from_origin
from rasterio.warp import Resampling, reproject

from pipeline.errors import InputError
from pipeline.geo.raster_file import opened
from pipeline.geo.search_area import load_search_area
from pipeline.geo.terrain import Terrain


@dataclass(frozen=True)
class CoverFile:
    """hidden: of people within the polygons of a file the share hidden, 0..1; None: the file is a raster of it.
    whole: the raster's value for all of them.
    """

    path: Path
    hidden: float | None
    whole: float = 1.0


def with_cover(terrain: Terrain, files: Iterable[CoverFile]) -> Terrain:
    """The terrain with the share hidden in each cell; where files overlap the greatest, where none says anything 0.

    Raises InputError for a file that is none, has values that are no shares, or does not meet the terrain.
    """
    cover = np.zeros(terrain.shape, dtype=np.float32)
    for file in files:
        share = _of_raster(file, terrain) if file.hidden is None else _of_polygons(file, terrain, file.hidden)
        if np.isnan(share).all():
            raise InputError(file.path, "cover that does not meet the terrain", "cover of the ground there")
        np.fmax(cover, share, out=cover)
    return replace(terrain, cover=cover) if cover.any() else terrain


def _of_polygons(file: CoverFile, terrain: Terrain, hidden: float) -> NDArray[np.float32]:
    """NaN outside of the polygons: a cell belongs to that which holds its middle."""
    area = load_search_area(file.path, terrain.frame)
    shapes = [(shapely.Polygon(rings[0], rings[1:]), hidden) for rings in area.polygons]
    north_up = rasterize(
        shapes, out_shape=terrain.shape, transform=_north_up(terrain), fill=np.nan, dtype="float32"
    )
    return np.asarray(north_up[::-1], dtype=np.float32)


def _of_raster(file: CoverFile, terrain: Terrain) -> NDArray[np.float32]:
    """The mean over each cell; NaN where the raster says nothing."""
    expected = f"one band of values 0 to {file.whole:g}, the share of people hidden"
    north_up = np.full(terrain.shape, np.nan, dtype=np.float32)
    with opened(file.path) as source:
        if source.count != 1 or "complex" in source.dtypes[0]:
            found = f"{source.count} bands of {source.dtypes[0]}"
            raise InputError(file.path, found, expected)
        reproject(
            _values(source), north_up, src_transform=source.transform, src_crs=source.crs, src_nodata=np.nan,
            dst_transform=_north_up(terrain), dst_crs=terrain.frame.crs.to_wkt(), dst_nodata=np.nan,
            resampling=Resampling.average,
        )  # fmt: skip
    share = north_up[::-1] / np.float32(file.whole)
    wrong = (share < 0.0) | (share > 1.0 + 1e-6)
    if wrong.any():
        value = float(share[wrong][0]) * file.whole
        raise InputError(file.path, f"a value of {value:g}", f"{expected} (cover.unit)")
    return np.asarray(np.minimum(share, 1.0), dtype=np.float32)


def _values(source: Any) -> NDArray[np.float32]:
    """Of the only band, NaN where it says nothing."""
    values = source.read(1, masked=True).astype(np.float32)
    return np.asarray(values.filled(np.nan), dtype=np.float32)


def _north_up(terrain: Terrain) -> Any:
    north_m = terrain.north_m + terrain.shape[0] * terrain.cell_m
    return from_origin(terrain.east_m, north_m, terrain.cell_m, terrain.cell_m)
