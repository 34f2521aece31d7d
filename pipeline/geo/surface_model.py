"""Surface models as people have them: what a raster's heights mean, and its heights where they are needed.

A band says its unit, scale, offset and nodata value, and the CRS its vertical datum; all of them are honoured. What
a file does not say is found in its heights where that is certain (-9999 is no height), and noted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import rasterio
from numpy.typing import NDArray
from pyproj import Transformer
from rasterio.enums import ColorInterp
from rasterio.warp import Resampling, reproject
from rasterio.windows import Window

from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.raster_content import (
    HIGHEST_M,
    LOWEST_M,
    SENTINELS,
    masked_cells,
    note_impossible,
    overview_of,
    picture_reason,
    zeros_are_unknown,
)
from pipeline.geo.raster_file import EXPECTED, horizontal, opened, vertical

Heights = NDArray[np.float32]
HeightUnit = Literal["meters", "feet", "us_survey_feet", "decimeters", "centimeters", "millimeters"]
HeightDatum = Literal["ellipsoid", "geoid"]

METERS_PER: dict[HeightUnit, float] = {
    "meters": 1.0, "feet": 0.3048, "us_survey_feet": 1200.0 / 3937.0, "decimeters": 0.1, "centimeters": 0.01,
    "millimeters": 0.001,
}  # fmt: skip
_UNIT_NAMES: dict[str, HeightUnit] = {
    "m": "meters", "metre": "meters", "metres": "meters", "meter": "meters", "meters": "meters",
    "ft": "feet", "foot": "feet", "feet": "feet", "international foot": "feet", "us survey foot": "us_survey_feet",
    "us-ft": "us_survey_feet", "ftus": "us_survey_feet", "us survey feet": "us_survey_feet",
    "foot_us": "us_survey_feet",
    "foot us": "us_survey_feet", "us_survey_foot": "us_survey_feet", "dm": "decimeters", "decimetre": "decimeters",
    "mm": "millimeters", "millimetre": "millimeters", "millimeter": "millimeters", "millimeters": "millimeters",
    "cm": "centimeters", "centimetre": "centimeters", "centimeter": "centimeters", "centimeters": "centimeters",
}  # fmt: skip
_GEOID_DRIVERS = ("SRTMHGT", "DTED")
#: cells of a source that are read at a time
_MOST_CELLS = 24_000_000


@dataclass(frozen=True, eq=False)
class SurfaceModel:
    """What a raster is. meters_per_unit, scale, offset: height = (value * scale + offset) * meters_per_unit.

    datum: None where the file does not say it. zero_is_unknown: its zeros are no heights. notes: what was found
    without being said, a sentence each.
    """

    path: Path
    meters_per_unit: float
    scale: float
    offset: float
    nodata: float | None
    datum: HeightDatum | None
    zero_is_unknown: bool
    notes: tuple[str, ...]


def inspect(path: Path, unit: HeightUnit | None = None, nodata: float | None = None) -> SurfaceModel:
    """What a file holds. unit, nodata: instead of what the file says. Raises InputError if it is no model."""
    with opened(path) as source:
        if not _is_one_band(source) or source.dtypes[0] in ("uint8", "int8") or "complex" in source.dtypes[0]:
            found = f"a picture or a mask ({source.count} bands of {source.dtypes[0]}), no surface model"
            raise InputError(path, found, EXPECTED)
        notes: list[str] = []
        meters_per_unit = _meters_per_unit(source, unit, notes)
        scale, offset = float(source.scales[0]), float(source.offsets[0])
        if not (math.isfinite(scale) and math.isfinite(offset) and scale != 0.0):
            raise InputError(
                f"{path} scale, offset", f"{scale:g}, {offset:g}", "finite numbers, the scale not 0"
            )
        nodata = source.nodata if nodata is None else nodata
        overview = overview_of(source, nodata)
        heights = (overview * scale + offset) * meters_per_unit
        reason = picture_reason(source, nodata, scale * meters_per_unit, heights, overview)
        if reason:
            unit_hint = "; or terrain.unit, if they are centimeters or millimeters"
            expected = EXPECTED + (unit_hint if "would be heights" in reason else "")
            raise InputError(path, f"a picture, no surface model: {reason}", expected)
        note_impossible(heights, overview, notes)
        zero_is_unknown = nodata != 0.0 and offset == 0.0 and zeros_are_unknown(heights)
        if zero_is_unknown:
            notes.append(
                "zeros at the border or in holes, beside much higher ground, are taken for unknown, not for ground"
            )
        return SurfaceModel(
            path, meters_per_unit, scale, offset, nodata, _datum(source), zero_is_unknown, tuple(notes)
        )


def center_wgs84(path: Path) -> tuple[float, float]:
    """Latitude and longitude of the middle of a surface model, degrees."""
    with opened(path) as source:
        east, north = source.transform * (source.width / 2.0, source.height / 2.0)
        longitude, latitude = Transformer.from_crs(horizontal(source), "EPSG:4326", always_xy=True).transform(
            east, north
        )
    if not (math.isfinite(latitude) and math.isfinite(longitude)):
        raise InputError(path, "a place that is not on Earth", EXPECTED)
    return float(latitude), float((longitude + 180.0) % 360.0 - 180.0)


def bounds_m(path: Path, frame: LocalFrame) -> tuple[float, float, float, float]:
    """West, south, east and north edge of a surface model in the map frame, metres."""
    with opened(path) as source:
        edge = np.linspace(0.0, 1.0, 22)
        one, zero = np.ones(22), np.zeros(22)
        x = np.concatenate([edge, edge, zero, one]) * source.width
        y = np.concatenate([zero, one, edge, edge]) * source.height
        east, north = _from_pixels(source, frame, x, y)
    known = np.isfinite(east) & np.isfinite(north)
    if not known.any():
        raise InputError(path, "a place that is not on Earth", EXPECTED)
    return tuple(
        float(v) for v in (east[known].min(), north[known].min(), east[known].max(), north[known].max())
    )  # type: ignore[return-value]


def resample(
    model: SurfaceModel,
    frame: LocalFrame,
    cell_m: float,
    west_m: float,
    north_m: float,
    shape: tuple[int, int],
) -> Heights:
    """Heights (rows, columns), metres, of a part of the map frame whose north-west corner is given, row 0 in the north.

    NaN where the model knows none. Only the part of the file that lies there is read.
    """
    result = np.full(shape, np.nan, dtype=np.float32)
    with opened(model.path) as source:
        for row, rows in _strips(source, frame, cell_m, west_m, north_m, shape):
            window = _window(source, frame, (west_m, north_m - row * cell_m), cell_m, (rows, shape[1]))
            if window is None:
                continue
            values = source.read(1, window=window)
            heights = _heights(model, values)
            masked = masked_cells(source, window=window)
            if masked is not None:
                heights[masked] = np.nan
            part = np.full((rows, shape[1]), np.nan, dtype=np.float32)
            reproject(
                heights,
                part,
                src_transform=source.window_transform(window),
                src_crs=source.crs,
                src_nodata=np.nan,
                dst_transform=rasterio.transform.from_origin(west_m, north_m - row * cell_m, cell_m, cell_m),
                dst_crs=frame.crs.to_wkt(),
                dst_nodata=np.nan,
                resampling=Resampling.average if _finer(source, frame, cell_m) else Resampling.bilinear,
            )
            result[row : row + rows] = part
    return result


def _is_one_band(source: rasterio.DatasetReader) -> bool:
    """Of heights; an alpha band beside it says where there are any."""
    return source.count == 1 or (source.count == 2 and source.colorinterp[1] == ColorInterp.alpha)


def _meters_per_unit(source: rasterio.DatasetReader, told: HeightUnit | None, notes: list[str]) -> float:
    if told is not None:
        return METERS_PER[told]
    by_crs = _vertical_factor(source)
    name = (source.units[0] or "").strip().lower()
    if not name:
        return by_crs or 1.0
    if name not in _UNIT_NAMES:
        raise InputError(
            f"{source.name} band unit", repr(name), f"terrain.unit: one of {', '.join(METERS_PER)}"
        )
    by_band = METERS_PER[_UNIT_NAMES[name]]
    if by_crs is not None and abs(by_band / by_crs - 1.0) > 1e-3:
        notes.append(
            f"the band's unit is {name}, its CRS says {by_crs:g} m; the band's is used (terrain.unit)"
        )
    return by_band


def _vertical_factor(source: rasterio.DatasetReader) -> float | None:
    part = vertical(source)
    return None if part is None else float(part.axis_info[-1].unit_conversion_factor)


def _datum(source: rasterio.DatasetReader) -> HeightDatum | None:
    part = vertical(source)
    if part is None:
        # by their standards both count from EGM96
        return "geoid" if source.driver in _GEOID_DRIVERS else None
    is_ellipsoid = len(part.axis_info) == 3 or "ellipsoid" in part.name.lower()
    return "ellipsoid" if is_ellipsoid else "geoid"


def _heights(model: SurfaceModel, values: NDArray[np.generic]) -> Heights:
    heights = (values.astype(np.float32) * np.float32(model.scale) + np.float32(model.offset)) * np.float32(
        model.meters_per_unit
    )
    unknown = ~np.isfinite(heights) | (heights < LOWEST_M) | (heights > HIGHEST_M)
    if model.nodata is not None:
        unknown |= values == np.asarray(model.nodata).astype(values.dtype, copy=False)
    if model.zero_is_unknown:
        unknown |= values == 0
    # before scale and unit, or -9999 cm would be ground at -100 m
    unknown |= np.isin(values, SENTINELS)
    heights[unknown] = np.nan
    return np.asarray(heights, dtype=np.float32)


def _from_pixels(
    source: rasterio.DatasetReader, frame: LocalFrame, x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    t = source.transform
    east, north = t.a * x + t.b * y + t.c, t.d * x + t.e * y + t.f
    transformer = Transformer.from_crs(horizontal(source), frame.crs, always_xy=True)
    return transformer.transform(east, north)


def _window(
    source: rasterio.DatasetReader,
    frame: LocalFrame,
    corner_m: tuple[float, float],
    cell_m: float,
    shape: tuple[int, int],
) -> Window | None:
    """The part of a raster that covers a part of the map frame, with a margin; None if none of it does."""
    edge = np.linspace(0.0, 1.0, 12)
    x, y = (v.ravel() for v in np.meshgrid(edge * shape[1] * cell_m, edge * shape[0] * cell_m))
    transformer = Transformer.from_crs(frame.crs, horizontal(source), always_xy=True)
    east, north = transformer.transform(corner_m[0] + x, corner_m[1] - y)
    if source.crs.is_geographic:
        # a raster may count its longitudes on from 180, or up to 360
        middle, _ = source.transform * (source.width / 2.0, source.height / 2.0)
        east = middle + np.mod(np.asarray(east) - middle + 180.0, 360.0) - 180.0
    inverse = ~source.transform
    columns = inverse.a * np.asarray(east) + inverse.b * np.asarray(north) + inverse.c
    rows = inverse.d * np.asarray(east) + inverse.e * np.asarray(north) + inverse.f
    known = np.isfinite(columns) & np.isfinite(rows)
    if not known.any():
        return None
    margin = 3
    left, right = math.floor(columns[known].min()) - margin, math.ceil(columns[known].max()) + margin
    top, bottom = math.floor(rows[known].min()) - margin, math.ceil(rows[known].max()) + margin
    left, right = max(left, 0), min(right, source.width)
    top, bottom = max(top, 0), min(bottom, source.height)
    return Window(left, top, right - left, bottom - top) if left < right and top < bottom else None


def _strips(
    source: rasterio.DatasetReader,
    frame: LocalFrame,
    cell_m: float,
    west_m: float,
    north_m: float,
    shape: tuple[int, int],
) -> Iterator[tuple[int, int]]:
    """First row and number of rows of strips, each of which needs a part of the raster that fits into memory."""
    window = _window(source, frame, (west_m, north_m), cell_m, shape)
    if window is None:
        return
    count = max(1, math.ceil(window.width * window.height / _MOST_CELLS))
    rows = max(1, math.ceil(shape[0] / count))
    for row in range(0, shape[0], rows):
        yield row, min(rows, shape[0] - row)


def _finer(source: rasterio.DatasetReader, frame: LocalFrame, cell_m: float) -> bool:
    """Whether the raster's cells are clearly smaller than those that are asked for."""
    middle = source.width / 2.0, source.height / 2.0
    x = np.array([middle[0], middle[0] + 1.0, middle[0]])
    y = np.array([middle[1], middle[1], middle[1] + 1.0])
    east, north = _from_pixels(source, frame, x, y)
    size_m = math.sqrt(
        abs((east[1] - east[0]) * (north[2] - north[0]) - (east[2] - east[0]) * (north[1] - north[0]))
    )
    return size_m < 0.75 * cell_m


def mosaic(
    models: Sequence[SurfaceModel],
    frame: LocalFrame,
    cell_m: float,
    west_m: float,
    north_m: float,
    shape: tuple[int, int],
) -> Heights:
    """As resample, of several models; where they overlap the first that knows a height counts."""
    result = resample(models[0], frame, cell_m, west_m, north_m, shape)
    for model in models[1:]:
        unknown = np.isnan(result)
        if not unknown.any():
            break
        np.copyto(result, resample(model, frame, cell_m, west_m, north_m, shape), where=unknown)
    return result
