"""Quantities in YAML carry their unit: ``cell_size: {meters: 0.5}``. A bare number or another unit fails."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from pipeline.config.base import mismatch

_METERS = {"meters": 1.0, "centimeters": 0.01, "kilometers": 1000.0}
_SECONDS = {"seconds": 1.0, "milliseconds": 1e-3, "microseconds": 1e-6, "minutes": 60.0, "hours": 3600.0}
_HERTZ = {"hertz": 1.0}
_BPS = {"bps": 1.0, "kbps": 1e3, "mbps": 1e6, "gbps": 1e9}
_RADIANS = {"degrees": math.pi / 180.0, "radians": 1.0}
_BYTES = {"megabytes": 1e6, "gigabytes": 1e9}
_MPS = {"meters_per_second": 1.0}
_MILLIMETERS = {"millimeters": 1.0}
_PIXELS = {"pixels": 1.0}


def _quantity(units: dict[str, float], low: float, high: float) -> Callable[[Any], float]:
    choices = " or ".join(f"{{{name}: NUMBER}}" for name in units)

    def parse(value: Any) -> float:
        if not isinstance(value, dict) or len(value) != 1:
            raise ValueError(f"expected {choices}")
        ((unit, number),) = value.items()
        if unit not in units:
            raise mismatch(f"the unit {unit!r}", choices)
        result = _number(number, unit) * units[unit]
        if not low <= result <= high:
            side, bound = ("at least", low) if result < low else ("at most", high)
            raise ValueError(f"expected {side} {{{unit}: {bound / units[unit]:g}}}")
        return result

    return parse


def _number(value: Any, unit: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"expected a number of {unit}")
    try:
        number = float(value)
    except OverflowError:
        raise ValueError(f"expected a number of {unit} that fits a float") from None
    if math.isnan(number):
        raise ValueError(f"expected a number of {unit}")
    return number


_INF = math.inf
#: no length or time in a search is greater; what is, is a slip
_MOST = 1e9
Meters = Annotated[float, BeforeValidator(_quantity(_METERS, -_MOST, _MOST))]
NonNegativeMeters = Annotated[float, BeforeValidator(_quantity(_METERS, 0.0, _MOST))]
PositiveMeters = Annotated[float, BeforeValidator(_quantity(_METERS, 1e-9, _MOST))]
Seconds = Annotated[float, BeforeValidator(_quantity(_SECONDS, -_MOST, _MOST))]
PositiveSeconds = Annotated[float, BeforeValidator(_quantity(_SECONDS, 1e-9, _MOST))]
Hertz = Annotated[float, BeforeValidator(_quantity(_HERTZ, 1e-6, 1e6))]
#: bits per second; ``{mbps: .inf}`` is a link without limit
BitsPerSecond = Annotated[float, Field(allow_inf_nan=True), BeforeValidator(_quantity(_BPS, 0.0, _INF))]
#: bits per second of a video
Bitrate = Annotated[float, BeforeValidator(_quantity(_BPS, 1.0, 1e12))]
Radians = Annotated[float, BeforeValidator(_quantity(_RADIANS, -_MOST, _MOST))]
NonNegativeRadians = Annotated[float, BeforeValidator(_quantity(_RADIANS, 0.0, math.pi))]
#: a focal length, millimetres
Millimeters = Annotated[float, BeforeValidator(_quantity(_MILLIMETERS, 1.0, 1e4))]
NonNegativePixels = Annotated[float, BeforeValidator(_quantity(_PIXELS, 0.0, _MOST))]
Bytes = Annotated[float, BeforeValidator(_quantity(_BYTES, 0.0, 1e15))]
Fraction = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
MetersPerSecond = Annotated[float, BeforeValidator(_quantity(_MPS, 0.0, 1e4))]
