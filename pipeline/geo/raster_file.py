"""A georeferenced raster, opened: one line for what cannot be read, and no more memory than the reading needs."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rasterio
from pyproj import CRS
from pyproj.exceptions import ProjError
from rasterio.errors import NotGeoreferencedWarning, RasterioError

from pipeline.errors import InputError

EXPECTED = "a GeoTIFF surface model: one band of heights, with a CRS and its place"
#: ``rio`` comes with rasterio, which reads the rasters here
WITH_CRS = (
    "a GeoTIFF with a coordinate reference system. If you know it, write it in: `rio edit-info --crs EPSG:25833 FILE` "
    "for a GeoTIFF; for .asc and .xyz a file of the same name with the ending .prj beside it"
)
#: what of a raster may stay in memory, bytes: GDAL's own 5 % of the machine made 600 MB of a file of 400 MB
_LEAST_CACHE, _MOST_CACHE = 64_000_000, 512_000_000


@contextmanager
def opened(path: Path) -> Iterator[rasterio.DatasetReader]:
    """The raster, if it has a CRS and a place. Raises InputError for what cannot be read, also while it is used."""
    if not path.is_file():
        raise InputError(path, "no file", EXPECTED)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            source = rasterio.open(path)
    except (RasterioError, ValueError) as error:
        raise InputError(path, "a file that is not a raster", EXPECTED) from error
    with rasterio.Env(GDAL_CACHEMAX=_cache_bytes(source)), source:
        if source.crs is None:
            raise InputError(f"{path} CRS", "none", WITH_CRS)
        if source.transform.is_identity or source.transform.determinant == 0.0:
            raise InputError(f"{path} georeference", "none", "a GeoTIFF that says where it lies")
        try:
            yield source
        except (RasterioError, ProjError, MemoryError, OverflowError, ValueError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(path, f"a raster that cannot be read whole ({reason[:120]})", EXPECTED) from None


def _cache_bytes(source: rasterio.DatasetReader) -> int:
    """Three rows of blocks: with less than one, each line of a window would decode its blocks again."""
    height, width = source.block_shapes[0] if source.count else (1, 1)
    row = height * (-(-source.width // width) * width) * 8
    return max(_LEAST_CACHE, min(3 * row, _MOST_CACHE))


def vertical(source: rasterio.DatasetReader) -> CRS | None:
    """The vertical part of a compound CRS, or the CRS itself where it has three axes."""
    crs = CRS.from_wkt(source.crs.to_wkt())
    parts = [part for part in crs.sub_crs_list if part.is_vertical]
    if parts:
        return parts[0]
    return crs if len(crs.axis_info) == 3 else None


def horizontal(source: rasterio.DatasetReader) -> CRS:
    """The horizontal part of the CRS."""
    crs = CRS.from_wkt(source.crs.to_wkt())
    return next((part for part in crs.sub_crs_list if not part.is_vertical), crs)
