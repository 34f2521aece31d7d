"""What the values of a raster say: whether they are heights at all, and which of them are none."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.enums import ColorInterp, MaskFlags, Resampling
from rasterio.windows import Window
from scipy.ndimage import binary_dilation

from pipeline.geo.raster_file import horizontal

#: the Dead Sea's shore and Mount Everest, with room: what lies outside is no height, metres
LOWEST_M, HIGHEST_M = -600.0, 9200.0
#: values that stand for unknown in so many files that they are no heights, tagged or not
SENTINELS = (-9999.0, -32768.0, -32767.0, -99999.0)
#: zeros at the border are no sea if the ground beside them stands so high, metres, for the most part
_CLIFF_M = 10.0
_OVERVIEW = 512
#: a raster without overviews that has more cells is looked at in so many rows and columns of single cells
_MOST_CELLS, _SAMPLES = 400_000_000, 24
#: values of more kinds than sentinels have, in more of the cells than a border has, that are no heights
_MOST_SENTINELS, _MOST_OUTSIDE = 20, 0.1
#: half of all neighbouring cells differ by more: no ground is as steep (72 degrees), no surface model as rough
_STEEPEST, _ROUGHEST_M = 3.0, 1.0
#: cells on the side of a window in which neighbours are compared, and how many pairs tell anything
_WINDOW, _LEAST_PAIRS = 65, 200
_METERS_PER_DEGREE = 111_320.0
_NO_HEIGHTS = re.compile(
    r"\b(red|green|blue|nir|swir|rgb|ndvi|panchromatic|alpha|intensity|reflectance|temperature|thermal|lwir|"
    r"hillshade|slope|aspect|mask)\b",
    re.IGNORECASE,
)


def overview_of(source: rasterio.DatasetReader, nodata: float | None) -> NDArray[np.float64]:
    """Values of the whole raster, coarse; NaN where it says that there are none."""
    rows, columns = min(source.height, _OVERVIEW), min(source.width, _OVERVIEW)
    if source.height * source.width > _MOST_CELLS and not source.overviews(1):
        values = _sampled(source)
    else:
        values = source.read(1, out_shape=(rows, columns), resampling=Resampling.nearest)
    result = values.astype(np.float64)
    if values.shape == (rows, columns):
        masked = masked_cells(source, out_shape=(rows, columns), resampling=Resampling.nearest)
        if masked is not None:
            result[masked] = np.nan
    if nodata is not None:
        result[values == nodata] = np.nan
    return np.asarray(result)


def _sampled(source: rasterio.DatasetReader) -> NDArray[np.generic]:
    """Single cells, evenly, the border's too: to decode all of a large raster takes minutes."""
    rows = np.linspace(0, source.height - 1, _SAMPLES).astype(int).tolist()
    columns = np.linspace(0, source.width - 1, _SAMPLES).astype(int).tolist()
    cells = [[source.read(1, window=Window(c, r, 1, 1))[0, 0] for c in columns] for r in rows]
    return np.array(cells)


def share_words(share: float) -> str:
    """A share in per cent, never as 0.0 %."""
    return f"{share:.1%}" if share >= 0.001 else "less than 0.1%"


def picture_reason(
    source: rasterio.DatasetReader,
    nodata: float | None,
    meters_per_value: float,
    heights: NDArray[np.float64],
    values: NDArray[np.float64],
) -> str:
    """Why a raster of one band is no elevation model; empty if nothing says so. heights, values: of the overview.

    A band's name or colour says it, values that are no heights all over, or neighbouring cells that differ as no
    ground does. What is as smooth as ground, such as temperatures in whole degrees, cannot be told from it.
    """
    name = source.descriptions[0] or ""
    if _NO_HEIGHTS.search(name):
        return f"its band is called {name[:60]!r}"
    if source.colorinterp[0] not in (ColorInterp.gray, ColorInterp.undefined):
        return f"its band is {source.colorinterp[0].name}"
    known = np.isfinite(heights) & ~np.isin(values, SENTINELS)
    # below, the sea's floor is no picture
    outside = known & (heights > HIGHEST_M)
    if outside.sum() > _MOST_OUTSIDE * known.sum() and len(np.unique(heights[outside])) > _MOST_SENTINELS:
        low, high = heights[known].min(), heights[known].max()
        return f"its values would be heights from {low:,.0f} to {high:,.0f} m"
    rough_m, cell_m = _roughness_m(source, nodata) * abs(meters_per_value), cell_size_m(source)
    if rough_m > max(_ROUGHEST_M, _STEEPEST * cell_m):
        return f"neighbouring cells, {cell_m:.2g} m apart, differ by {rough_m:,.0f} m, in the median"
    return ""


def _roughness_m(source: rasterio.DatasetReader, nodata: float | None) -> float:
    """Median difference of neighbouring cells in nine windows, in the raster's own unit; 0 where few are known."""
    differences = []
    for part_y in (1, 3, 5):
        for part_x in (1, 3, 5):
            column = max(0, source.width * part_x // 6 - _WINDOW // 2)
            row = max(0, source.height * part_y // 6 - _WINDOW // 2)
            size = min(_WINDOW, source.width - column), min(_WINDOW, source.height - row)
            values = source.read(1, window=Window(column, row, *size)).astype(np.float64)
            values[~np.isfinite(values) | np.isin(values, SENTINELS) | (values == nodata)] = np.nan
            differences += [np.diff(values, axis=0).ravel(), np.diff(values, axis=1).ravel()]
    known = np.abs(np.concatenate(differences))
    known = known[np.isfinite(known)]
    return float(np.median(known)) if len(known) >= _LEAST_PAIRS else 0.0


def cell_size_m(source: rasterio.DatasetReader) -> float:
    """Side of a cell at the raster's middle, metres; the root of its area."""
    area = abs(source.transform.determinant)
    crs = horizontal(source)
    if crs.is_geographic:
        _, latitude = source.transform * (source.width / 2.0, source.height / 2.0)
        return float(np.sqrt(area * max(np.cos(np.radians(latitude)), 0.0))) * _METERS_PER_DEGREE
    return float(np.sqrt(area) * crs.axis_info[0].unit_conversion_factor)


def note_impossible(heights: NDArray[np.float64], values: NDArray[np.float64], notes: list[str]) -> None:
    """Add a note of values that are no heights. heights, values: (rows, columns), of the overview."""
    impossible = (heights < LOWEST_M) | (heights > HIGHEST_M) | np.isin(values, SENTINELS)
    outside = np.isfinite(heights) & impossible
    if outside.any():
        usual = np.unique(values[outside])[:3].tolist()
        notes.append(
            f"{share_words(float(outside.mean()))} of the cells hold {usual}, which are no heights: taken for unknown"
        )


def masked_cells(source: rasterio.DatasetReader, **where: Any) -> NDArray[np.bool_] | None:
    """Cells that a mask or an alpha band calls unknown; None if there is neither. where: as ``read`` takes it."""
    if source.count == 2:
        return np.asarray(source.read(2, **where) == 0)  # GDAL takes no alpha of floats for a mask
    if MaskFlags.per_dataset not in source.mask_flag_enums[0]:
        return None
    return np.asarray(source.read_masks(1, **where) == 0)


def zeros_are_unknown(heights: NDArray[np.float64]) -> bool:
    """Whether zeros stand for unknown, at the border or in holes: the ground beside them is a cliff."""
    zero = heights == 0.0
    beside = binary_dilation(zero) & ~zero & np.isfinite(heights)
    neighbours = np.abs(heights[beside])
    if not len(neighbours):
        return False
    return bool(np.median(neighbours) > _CLIFF_M and np.quantile(neighbours, 0.1) > _CLIFF_M / 2)
