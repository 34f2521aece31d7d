"""The probability of area, and what a search without success leaves of it.

A prior says where the person may be: the probability of area (POA) of every cell, and of elsewhere. Looking at a cell
with a probability of detection (POD) gives a probability of success, POS = sum of POA * POD over all cells. If nobody
was found, Bayes' rule leaves POA * (1 - POD) / (1 - POS) in each cell (Koopman, Search and Screening, 1946; IAMSAR
Manual, volume II, chapter 4; Robe and Frost, U.S. Coast Guard report CG-D-15-02, 2002).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.errors import RasterioError
from rasterio.warp import Resampling, reproject
from rasterio.warp import transform as transformed

from pipeline.config.prior import Prior
from pipeline.errors import InputError
from pipeline.geo.search_area import SearchArea, load_weighted_areas
from pipeline.geo.terrain import Terrain
from pipeline.messages import FloatArray
from pipeline.second_look.cells import cells_inside

#: of a raster
_MOST_PIXELS = 100_000_000
_EXPECTED_RASTER = "a GeoTIFF of weights of 0 or more, with a CRS"


@dataclass(frozen=True, eq=False)
class Remaining:
    """After a search in which the person was not found.

    poa: before it, float64 (rows, columns) over the map's cells, row 0 in the south; what is missing to 1 is elsewhere.
    left: the same after it. pos: the probability of success that the search had.
    """

    poa: FloatArray
    left: FloatArray
    pos: float

    @property
    def on_map(self) -> float:
        """The probability, before the search, that the person is on the map at all."""
        return float(self.poa.sum())


def remaining(poa: FloatArray, pod: NDArray[np.floating]) -> Remaining:
    """What is left of a prior. poa, pod: (rows, columns), 0..1; poa sums to 1 at most."""
    pos = min(float((poa * pod).sum()), 1.0)
    # nothing is left of a person who was certain to be found and was not: the prior was wrong
    left = poa * (1.0 - pod) / (1.0 - pos) if pos < 1.0 else np.zeros_like(poa)
    return Remaining(poa, left, pos)


def area_probability(prior: Prior, terrain: Terrain) -> FloatArray:
    """POA of every cell, float64 (rows, columns). Raises InputError for a file that is no prior.

    What of the prior lies off the map is in no cell: the sum is less than 1 by that.
    """
    if prior.file is None:
        return _of_rings(prior, terrain)
    if prior.file.suffix.lower() in (".json", ".geojson"):
        return prior.inside * _of_polygons(prior.file, terrain)
    return prior.inside * _of_raster(prior.file, terrain)


def _of_rings(prior: Prior, terrain: Terrain) -> FloatArray:
    """The person is anywhere in a ring with equal density."""
    assert prior.last_known_point is not None
    latitude, longitude = (
        math.degrees(v) for v in (prior.last_known_point.latitude, prior.last_known_point.longitude)
    )
    east, north = terrain.frame.enu_from_wgs84(np.array(latitude), np.array(longitude))
    rows, columns = terrain.shape
    x = terrain.east_m + (np.arange(columns) + 0.5) * terrain.cell_m - float(east)
    y = terrain.north_m + (np.arange(rows) + 0.5) * terrain.cell_m - float(north)
    squared_m2 = x[None, :] ** 2 + y[:, None] ** 2
    poa = np.zeros(terrain.shape)
    for inner_m, outer_m, share in _annuli(prior):
        density = share / (math.pi * (outer_m**2 - inner_m**2))
        poa[(squared_m2 >= inner_m**2) & (squared_m2 < outer_m**2)] = density * terrain.cell_m**2
    return _at_most_one(poa)


def _annuli(prior: Prior) -> Iterator[tuple[float, float, float]]:
    """Inner and outer radius, metres, and the probability between them."""
    inner_m, known = 0.0, 0.0
    for ring in prior.rings:
        yield inner_m, ring.within, ring.probability - known
        inner_m, known = ring.within, ring.probability


def _of_polygons(path: Path, terrain: Terrain) -> FloatArray:
    areas = load_weighted_areas(path, terrain.frame)
    total = math.fsum(weight for _, weight in areas)
    if not 0.0 < total < math.inf:
        raise InputError(path, f"weights that sum to {total:g}", "one above 0 at least")
    poa = np.zeros(terrain.shape)
    for area, weight in areas:
        inside = cells_inside(area, terrain)
        poa[inside] += weight / total * _cell_share(area, int(inside.sum()), terrain.cell_m**2)
    return _at_most_one(poa)


def _cell_share(area: SearchArea, cells: int, cell_m2: float) -> float:
    """What of an area one of its cells holds; all cells together never more than all of it."""
    return min(cell_m2 / area.area_m2, 1.0 / max(cells, 1))


def _of_raster(path: Path, terrain: Terrain) -> FloatArray:
    try:
        with rasterio.open(path) as source:
            if source.width * source.height > _MOST_PIXELS:
                found = f"{source.width} x {source.height} pixels"
                raise InputError(path, found, f"{_MOST_PIXELS:,} at most")
            if source.crs is None:
                raise InputError(path, "a raster without a CRS", _EXPECTED_RASTER)
            weights = source.read(1, masked=True).astype(np.float64).filled(np.nan)
            crs, transform = source.crs, source.transform
    except (RasterioError, OSError, ValueError) as error:
        raise InputError(path, f"what cannot be read ({type(error).__name__})", _EXPECTED_RASTER) from None
    weights = np.where(np.isnan(weights), 0.0, weights)  # no data: nobody is there
    if weights.min() < 0.0 or not np.isfinite(weights).all():
        worst = weights.min() if weights.min() < 0.0 else math.inf
        raise InputError(path, f"a weight of {worst:g}", _EXPECTED_RASTER)
    total = float(weights.sum())
    if not 0.0 < total < math.inf:
        raise InputError(path, f"weights that sum to {total:g}", "one above 0 at least")
    density = np.zeros(terrain.shape)
    north_m = terrain.north_m + terrain.shape[0] * terrain.cell_m
    reproject(
        weights / total,
        density,
        src_transform=transform,
        src_crs=crs,
        dst_transform=rasterio.Affine(terrain.cell_m, 0.0, terrain.east_m, 0.0, -terrain.cell_m, north_m),
        dst_crs=terrain.frame.crs.to_wkt(),
        resampling=Resampling.nearest,
    )
    return _at_most_one(
        density[::-1] * (terrain.cell_m**2 / _pixel_m2(transform, crs, weights.shape, terrain))
    )


def _pixel_m2(
    transform: rasterio.Affine, crs: rasterio.crs.CRS, shape: tuple[int, ...], terrain: Terrain
) -> float:
    """The area of the raster's middle pixel."""
    row, column = shape[0] // 2, shape[1] // 2
    corners = [transform @ (column + x, row + y) for x, y in ((0, 0), (1, 0), (0, 1))]
    east, north = transformed(crs, terrain.frame.crs.to_wkt(), *zip(*corners, strict=True))
    (ax, bx), (ay, by) = np.array(east)[1:] - east[0], np.array(north)[1:] - north[0]
    return float(abs(ax * by - ay * bx))


def _at_most_one(poa: FloatArray) -> FloatArray:
    """Cells at borders are counted whole, so that the sum may be above 1 by a little."""
    return poa / max(float(poa.sum()), 1.0)
