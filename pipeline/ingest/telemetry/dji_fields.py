"""What DJI writes in one cue, in the dialects of its drones.

``[key: value]``      Mavic 2 and later, the enterprise drones: position, heights, gimbal angles, focal length.
``GPS(lon, lat, n)``  older ones; n counts satellites. ``RTK(lon, lat, n)``: the Phantom 4 RTK.
``GPS(lat, lon, h)``  the Matrice 300 (h with an M) and the Avata 2 (h with decimals): latitude first.
``BAROMETER``, ``Hb``, ``H``: height above take-off. ``G.PRY``, ``F.PRY``: pitch, roll and yaw of the gimbal and of
the aircraft, degrees.
"""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime
from typing import Literal

GpsOrder = Literal["longitude_first", "latitude_first"]

_BRACKET_FIELDS = {
    "latitude": "latitude",
    "longitude": "longitude",
    "longtitude": "longitude",  # so spelt by the Mavic 2
    "rel_alt": "relative_height",
    "abs_alt": "absolute_height",
    "altitude": "absolute_height",
    "gb_yaw": "yaw",
    "gb_pitch": "pitch",
    "gb_roll": "roll",
}
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_BRACKET = re.compile(r"\[([^\]\[]*)\]")
_KEY_VALUE = re.compile(r"(\w+)\s*:\s*([^\s,\]]+)")
_TRIPLE = rf"\(\s*({_NUMBER})\s*,\s*({_NUMBER})\s*,\s*({_NUMBER})\s*([mM]?)\s*\)"
_GPS = re.compile(rf"\b(GPS|RTK)\s*{_TRIPLE}")
_PRY = re.compile(
    rf"\b([GF])\.PRY\s*\(\s*({_NUMBER})\s*°?\s*,\s*({_NUMBER})\s*°?\s*,\s*({_NUMBER})\s*°?\s*\)"
)
_RELATIVE_HEIGHT = re.compile(
    rf"(?:\bBAROMETER\s*[:(]|\bHb\s*:|(?:^|[,\s])H\s)\s*({_NUMBER})\s*[mM]?(?=[\s,)]|$)", re.MULTILINE
)
_DATE = re.compile(
    r"(\d{4})[-./](\d{1,2})[-./](\d{1,2})[ T](\d{1,2}):(\d{2}):(\d{2})(?:[.,](\d+)(?:,(\d{3}))?)?"
)
#: few satellites: metres of standard deviation; with RTK: decimetres
_FEW_SATELLITES, _POOR_SD_M, _RTK_SD_M = 6.0, 5.0, 0.1
#: no lens is longer, millimetres of equivalent focal length; tenths of millimetres are then meant
_LONGEST_MM = 2000.0


def fields_of(text: str, order: GpsOrder | None = None) -> tuple[dict[str, float], bool]:
    """The fields of a cue by the names of ``samples.FIELDS``; NaN for a value that is no number.

    order: of ``GPS(a, b, h)``, where the mission says it. True if the order of such a position was assumed.
    """
    fields: dict[str, float] = {}
    for bracket in _BRACKET.findall(text):
        for key, value in _KEY_VALUE.findall(bracket):
            if key in _BRACKET_FIELDS:
                fields[_BRACKET_FIELDS[key]] = _number(value)
            elif key == "focal_len":
                fields["focal_length_35mm"] = _focal_length_mm(value)
    assumed = _position(text, fields, order)
    for kind, pitch, roll, yaw in _PRY.findall(text):
        prefix = "" if kind == "G" else "aircraft_"
        fields |= {f"{prefix}pitch": float(pitch), f"{prefix}roll": float(roll), f"{prefix}yaw": float(yaw)}
    if height := _RELATIVE_HEIGHT.search(text):
        fields["relative_height"] = float(height.group(1))
    return fields, assumed


def date_ns(text: str) -> int | None:
    """The date in a cue, ns since 1970 as if it were UTC; None if there is none, or none that exists."""
    date = _DATE.search(text)
    if date is None:
        return None
    try:
        year, month, day, hour, minute, second = (int(part) for part in date.groups()[:6])
        whole = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
    except ValueError:
        return None
    fraction = ((date.group(7) or "") + (date.group(8) or "")).ljust(9, "0")[:9]
    return int(whole.timestamp()) * 1_000_000_000 + int(fraction)


def _position(text: str, fields: dict[str, float], order: GpsOrder | None) -> bool:
    found = _GPS.search(text)
    if found is None:
        return False
    kind, *numbers, unit = found.groups()
    one, other, third = (float(number) for number in numbers)
    # a third value with decimals is a height; satellites are counted in whole numbers
    is_height = bool(unit) or not third.is_integer() or "." in numbers[2]
    latitude_first = is_height if order is None else order == "latitude_first"
    if latitude_first and abs(one) > 90.0 >= abs(other):
        latitude_first = False
    fields["latitude"], fields["longitude"] = (one, other) if latitude_first else (other, one)
    if kind == "RTK":
        fields |= {"horizontal_sd": _RTK_SD_M, "height_sd": _RTK_SD_M}
    elif not is_height and third < _FEW_SATELLITES:
        fields |= {"horizontal_sd": _POOR_SD_M, "height_sd": 1.5 * _POOR_SD_M}
    return order is None and is_height and not unit


def _focal_length_mm(text: str) -> float:
    """``240`` is 24.0 mm, ``24.00`` is 24 mm: a value without a point counts tenths."""
    value = _number(text)
    return value / 10.0 if text.isdigit() and value >= 100.0 else value


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
