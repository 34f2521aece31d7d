"""Units, as heads of tables spell them."""

from __future__ import annotations

import math
import re
from typing import Literal

Dimension = Literal["length", "angle", "duration"]

_LENGTH_M = {
    1.0: "m meter meters metre metres",
    0.3048: "ft foot feet",
    0.01: "cm centimeter centimeters centimetre centimetres",
    0.001: "mm millimeter millimeters millimetre millimetres",
    1000.0: "km kilometer kilometers kilometre kilometres",
    0.9144: "yd yard yards",
}
_ANGLE_DEG = {
    1.0: "° 360 180 deg degs degree degrees",
    math.degrees(1.0): "rad rads radian radians",
    math.degrees(1e-3): "mrad milliradian milliradians",
    0.1: "ddeg decidegree decidegrees deg10 0.1deg tenths_of_a_degree tenths",
    0.01: "cdeg centidegree centidegrees 0.01deg",
    1e-7: "dege7 1e-7deg deg*1e7",
    0.9: "gon gons grad gradian gradians",
}
_DURATION_S = {
    1.0: "s sec secs second seconds",
    1e-3: "ms msec millis millisecond milliseconds",
    1e-6: "us µs μs usec micros microsecond microseconds",
    1e-9: "ns nsec nanos nanosecond nanoseconds",
    60.0: "min minute minutes",
    3600.0: "h hour hours",
}


def _by_name(names_of_factor: dict[float, str]) -> dict[str, float]:
    return {name: factor for factor, names in names_of_factor.items() for name in names.split()}


_FACTORS: dict[Dimension, dict[str, float]] = {
    "length": _by_name(_LENGTH_M),
    "angle": _by_name(_ANGLE_DEG),
    "duration": _by_name(_DURATION_S),
}
_ZONES = ("utc", "gmt", "local", "z")
_BRACKETED = re.compile(r"^(.*?)\s*[(\[{]\s*([^()\[\]{}]*?)\s*[)\]}]\s*$")
_SUFFIXED = re.compile(
    r"^(.*[a-zA-Z0-9])_(m|ft|feet|meters|metres|deg|degrees|rad|radians|s|sec|seconds|ms|us|ns|utc|local)$"
)


def factor(unit: str, dimension: Dimension) -> float | None:
    """What a number of the unit is multiplied by to give metres, degrees or seconds; None: not a unit of it."""
    return _FACTORS[dimension].get(_plain(unit))


def unit_names(dimension: Dimension) -> str:
    """The units of a dimension, one spelling each, for messages."""
    tables = {"length": _LENGTH_M, "angle": _ANGLE_DEG, "duration": _DURATION_S}
    return ", ".join(names.split()[-1] for names in tables[dimension].values())


def is_unit(text: str) -> bool:
    """Whether a head's word is a unit or a zone, in brackets or not."""
    word = _plain(text.strip("()[]{} "))
    return word in _ZONES or any(word in names for names in _FACTORS.values())


def split_unit(name: str) -> tuple[str, str]:
    """A head's cell without its unit, and the unit or zone; empty where it has none.

    ``height(feet)``, ``height [ft]`` and ``height_ft`` are height in feet.
    """
    if (match := _BRACKETED.match(name)) is not None:
        return match.group(1).strip(), match.group(2)
    if (match := _SUFFIXED.match(name.strip())) is not None:
        return match.group(1), match.group(2)
    return name.strip(), ""


def _plain(unit: str) -> str:
    return re.sub(r"\s+", "_", unit.strip().lower())
