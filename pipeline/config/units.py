"""Quantities in YAML carry their unit: ``cell_size: {meters: 0.5}``. A bare number or another unit fails."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
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


@dataclass(frozen=True, eq=False)
class Quantity:
    """Reads ``{unit: number}``. units: how much of SI each one is. low, high: the range, in SI."""

    units: Mapping[str, float]
    low: float
    high: float

    def __call__(self, value: Any) -> float:
        """In SI units; ValueError if it is no such quantity or out of the range."""
        choices = " or ".join(f"{{{name}: NUMBER}}" for name in self.units)
        if not isinstance(value, dict) or len(value) != 1:
            raise ValueError(f"expected {choices}")
        ((unit, number),) = value.items()
        if unit not in self.units:
            raise mismatch(f"the unit {unit!r}", choices)
        result = _number(number, unit) * self.units[unit]
        if not self.low <= result <= self.high:
            side, bound = ("at least", self.low) if result < self.low else ("at most", self.high)
            raise ValueError(f"expected {side} {{{unit}: {bound / self.units[unit]:g}}}")
        return result


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
Meters = Annotated[float, BeforeValidator(Quantity(_METERS, -_MOST, _MOST))]
NonNegativeMeters = Annotated[float, BeforeValidator(Quantity(_METERS, 0.0, _MOST))]
PositiveMeters = Annotated[float, BeforeValidator(Quantity(_METERS, 1e-9, _MOST))]
Seconds = Annotated[float, BeforeValidator(Quantity(_SECONDS, -_MOST, _MOST))]
NonNegativeSeconds = Annotated[float, BeforeValidator(Quantity(_SECONDS, 0.0, _MOST))]
PositiveSeconds = Annotated[float, BeforeValidator(Quantity(_SECONDS, 1e-9, _MOST))]
Hertz = Annotated[float, BeforeValidator(Quantity(_HERTZ, 1e-6, 1e6))]
#: bits per second; ``{mbps: .inf}`` is a link without limit
BitsPerSecond = Annotated[float, Field(allow_inf_nan=True), BeforeValidator(Quantity(_BPS, 0.0, _INF))]
#: bits per second of a video
Bitrate = Annotated[float, BeforeValidator(Quantity(_BPS, 1.0, 1e12))]
Radians = Annotated[float, BeforeValidator(Quantity(_RADIANS, -_MOST, _MOST))]
NonNegativeRadians = Annotated[float, BeforeValidator(Quantity(_RADIANS, 0.0, math.pi))]
#: a focal length, millimetres
Millimeters = Annotated[float, BeforeValidator(Quantity(_MILLIMETERS, 1.0, 1e4))]
NonNegativePixels = Annotated[float, BeforeValidator(Quantity(_PIXELS, 0.0, _MOST))]
Bytes = Annotated[float, BeforeValidator(Quantity(_BYTES, 0.0, 1e15))]
Fraction = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
MetersPerSecond = Annotated[float, BeforeValidator(Quantity(_MPS, 0.0, 1e4))]
