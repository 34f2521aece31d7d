"""A grid of coordinates over a map picture: UTM on WGS84, whose last five digits are those of MGRS."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from pyproj import Transformer

from pipeline.geo.frame import LocalFrame
from pipeline.geo.grids import mgrs_of, utm_of
from pipeline.messages import FloatArray

#: lines across the shorter side, at most
_LINES = 8
_STYLE: dict[str, Any] = {"color": "#1b1b1b", "lw": 0.5, "alpha": 0.35, "zorder": 2.5}


def draw_grid(axes: Axes, frame: LocalFrame) -> None:
    """Draw the grid over axes in the map frame (metres) and label their edges. In polar regions: metres as they are."""
    west, east = axes.get_xlim()
    south, north = axes.get_ylim()
    middle = frame.wgs84_from_enu(np.array((west + east) / 2), np.array((south + north) / 2))
    utm = utm_of(float(middle[0]), float(middle[1]))
    if utm is None:
        origin = f"{frame.origin_latitude_deg:.6f}, {frame.origin_longitude_deg:.6f}"
        axes.set_xlabel(f"east of {origin} (WGS84), m")
        axes.set_ylabel("north, m")
        return
    to_utm = Transformer.from_crs(frame.crs, f"EPSG:{utm.epsg}", always_xy=True)
    corners = np.array([(west, south), (east, south), (east, north), (west, north)])
    eastings, northings = to_utm.transform(corners[:, 0], corners[:, 1])
    step_m = _round_step_m(min(east - west, north - south) / _LINES)
    along = np.linspace(0.0, 1.0, 33)
    marks: tuple[list[tuple[float, str]], list[tuple[float, str]]] = ([], [])
    for axis, values in enumerate((eastings, northings)):
        others = (northings, eastings)[axis]
        span_m = np.min(others) + along * np.ptp(others)
        first = math.ceil(np.min(values) / step_m)
        for number in range(first, math.floor(np.max(values) / step_m) + 1):
            value = number * step_m
            fixed = np.full_like(span_m, value)
            line = to_utm.transform(*((fixed, span_m) if axis == 0 else (span_m, fixed)), direction="INVERSE")
            axes.plot(*line, **_STYLE)
            at = _crossing(np.asarray(line), axis, (south, west)[axis])
            if (west, south)[axis] <= at <= (east, north)[axis]:
                marks[axis].append((at, f"{value:.0f}"))
    axes.set_xlim(west, east)
    axes.set_ylim(south, north)
    axes.set_xticks([at for at, _ in marks[0]], [text for _, text in marks[0]])
    axes.set_yticks([at for at, _ in marks[1]], [text for _, text in marks[1]], rotation=90, va="center")
    axes.set_xlabel(f"easting, m (WGS84, UTM zone {utm.zone}{utm.band}{_square(frame, corners)})")
    axes.set_ylabel("northing, m")


def _crossing(line: FloatArray, axis: int, edge: float) -> float:
    """Where a grid line (2, N) meets the picture's lower (axis 0) or left edge."""
    along = line[1 - axis]
    order = np.argsort(along)
    return float(np.interp(edge, along[order], line[axis][order]))


def _square(frame: LocalFrame, corners: FloatArray) -> str:
    """The square of MGRS that all of the picture lies in; empty where it is more than one."""
    latitude, longitude = frame.wgs84_from_enu(corners[:, 0], corners[:, 1])
    squares = {mgrs_of(float(a), float(o), 0) for a, o in zip(latitude, longitude, strict=True)}
    return f"; MGRS {squares.pop()} and the last five digits" if len(squares) == 1 else ""


def _round_step_m(least_m: float) -> float:
    """The least 1, 2 or 5 times a power of ten that is at least least_m, and at least 1 m."""
    power = 10.0 ** math.floor(math.log10(max(least_m, 1.0)))
    return next(digit * power for digit in (1.0, 2.0, 5.0, 10.0) if digit * power >= least_m * (1 - 1e-9))
