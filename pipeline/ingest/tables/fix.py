"""How good a position is, from what flight logs say about the satellites."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import FloatArray

#: with fewer satellites there is no position in three dimensions
_FEWEST = 4.0
#: at least so many satellites: standard deviation of each horizontal axis, metres. From 10 on the mission's
#: own uncertainty holds. The steps are assumed: horizontal dilution grows about so as satellites are lost.
_BY_SATELLITES = ((10.0, math.nan), (8.0, 2.0), (6.0, 4.0), (0.0, 10.0))
#: the same for DJI's GPS level, 0 (none) to 5 (very good)
_BY_LEVEL = ((4.0, math.nan), (3.0, 3.0), (2.0, 6.0), (0.0, 10.0))


def without_fix(
    latitude: FloatArray, longitude: FloatArray, values: Mapping[str, FloatArray], assumed: list[str]
) -> NDArray[np.bool_]:
    """Where there is no position: none written, 0 and 0, or too few satellites (the log repeats the last one).

    A column of satellites that is zero throughout is one that was never filled.
    """
    lacking = np.isnan(latitude) | np.isnan(longitude) | ((latitude == 0.0) & (longitude == 0.0))
    satellites, level = values.get("satellites"), values.get("gps_level")
    if level is not None and np.nan_to_num(level).any():
        lacking |= level < 1.0
    if satellites is None:
        return lacking
    if not np.nan_to_num(satellites).any():
        assumed.append("the column of satellites is empty: positions are taken as good")
        return lacking
    return lacking | (satellites < _FEWEST)


def fix_sd_m(values: Mapping[str, FloatArray]) -> FloatArray | None:
    """Standard deviation of each horizontal axis, metres, NaN for a good fix; None if all are good or none is said."""
    stated = [
        _steps(values[name], steps)
        for name, steps in (("satellites", _BY_SATELLITES), ("gps_level", _BY_LEVEL))
        if name in values and np.nan_to_num(values[name]).any()
    ]
    if not stated:
        return None
    widest = np.fmax.reduce(stated)
    return None if np.isnan(widest).all() else widest


def _steps(values: FloatArray, steps: tuple[tuple[float, float], ...]) -> FloatArray:
    result = np.full(len(values), math.nan)
    for least, sd_m in reversed(steps):
        result[values >= least] = sd_m
    return result
