"""What drones write in one cue of their subtitles, in the dialects of DJI and Autel.

``[key: value]``      Mavic 2 and later, the enterprise drones: position, heights, gimbal angles, focal length.
``GPS(lon, lat, n)``  older ones; n counts satellites. ``RTK(lon, lat, n)``: the Phantom 4 RTK.
``GPS(lat, lon, h)``  the Matrice 300 (h with an M) and the Avata 2 (h with decimals): latitude first. But with
                      ``D ..m, H ..m`` beside it, as on the Phantom 4, longitude first whatever the third value is.
``GPS(W: lon, N: lat, hm)`` Autel.
``BAROMETER:``, ``Hb:``, ``H``: height above take-off. ``BAROMETER(..)`` is not: on the Avata 2 it falls as the drone
climbs. ``G.PRY``, ``F.PRY``: pitch, roll and yaw of the gimbal and of the aircraft, degrees.
"""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime
from typing import Literal

GpsOrder = Literal["longitude_first", "latitude_first"]

_NAMED = {
    "latitude": "latitude",
    "longitude": "longitude",
    "longtitude": "longitude",  # so spelt by the Mavic 2
    "rel_alt": "relative_height",
    "abs_alt": "absolute_height",
    "altitude": "absolute_height",
    "gb_yaw": "yaw",
    "gb_pitch": "pitch",
    "gb_roll": "roll",
    "gimbal_yaw": "yaw",
    "gimbal_pitch": "pitch",
    "gimbal_roll": "roll",
    "drone_yaw": "aircraft_yaw",
    "drone_pitch": "aircraft_pitch",
    "drone_roll": "aircraft_roll",
}
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_KEY_VALUE = re.compile(r"([A-Za-z_]\w*)\s*:\s*([^\s\]\[]+)")
_TRIPLE = rf"\(\s*({_NUMBER})\s*,\s*({_NUMBER})\s*,\s*({_NUMBER})\s*([mM]?)\s*\)"
_GPS = re.compile(rf"\b(GPS|RTK)\s*{_TRIPLE}")
_PRY = re.compile(
    rf"\b([GF])\.PRY\s*\(\s*({_NUMBER})\s*°?\s*,\s*({_NUMBER})\s*°?\s*,\s*({_NUMBER})\s*°?\s*\)"
)
_RELATIVE_HEIGHT = re.compile(
    rf"(?:\bBAROMETER\s*:|\bHb\s*:|(?:^|[,\s])H[\s=])\s*({_NUMBER})\s*[mM]?(?=[\s,)]|$)", re.MULTILINE
)
_DISTANCE = re.compile(rf"(?:^|[,\s])D\s+{_NUMBER}\s*m\b", re.MULTILINE)
_AUTEL = re.compile(
    rf"\bGPS\s*\(\s*([EW])\s*:\s*({_NUMBER})\s*,\s*([NS])\s*:\s*({_NUMBER})\s*,\s*({_NUMBER})\s*m\s*\)"
)
_DATE = re.compile(
    r"(\d{4})[-./](\d{1,2})[-./](\d{1,2})[ T](\d{1,2}):(\d{2}):(\d{2})(?:[.,](\d+)(?:,(\d{3}))?)?"
)
_LATITUDE_IS_FIRST = (
    "GPS(a, b, height) is latitude, longitude, height, as the Avata 2 writes it; if it is longitude first, say "
    "telemetry.gps_order: longitude_first"
)
_THIRD_IS_HEIGHT = "the third value of GPS(a, b, height) is a height above the datum, not above take-off"
_AUTEL_HEIGHT = (
    "the height in GPS(.., .., height) is taken as the mission's telemetry.height says: absolute, above the datum; "
    "relative, above take-off (Autel does not say which it is)"
)
#: few satellites: metres of standard deviation; with RTK: decimetres
_FEW_SATELLITES, _POOR_SD_M, _RTK_SD_M = 6.0, 5.0, 0.1
#: no lens is longer, millimetres of equivalent focal length; tenths of millimetres are then meant
_LONGEST_MM = 2000.0


def fields_of(text: str, order: GpsOrder | None = None) -> tuple[dict[str, float], list[str]]:
    """The fields of a cue by the names of ``samples.FIELDS``, NaN for a value that is no number; what was assumed.

    order: of ``GPS(a, b, h)``, where the mission says it.
    """
    fields: dict[str, float] = {}
    for key, value in _KEY_VALUE.findall(text):
        if (name := _NAMED.get(key.lower())) is not None:
            fields[name] = _number(value)
        elif key == "focal_len":
            fields["focal_length_35mm"] = _focal_length_mm(value.rstrip(","))
    # words first: a search for a pattern that is not there costs more than all else in a long file
    assumed = _position(text, fields, order) if "GPS" in text or "RTK" in text else []
    for kind, pitch, roll, yaw in _PRY.findall(text) if "PRY" in text else []:
        prefix = "" if kind == "G" else "aircraft_"
        fields |= {f"{prefix}pitch": float(pitch), f"{prefix}roll": float(roll), f"{prefix}yaw": float(yaw)}
    if "relative_height" not in fields and (height := _RELATIVE_HEIGHT.search(text)):
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


def _position(text: str, fields: dict[str, float], order: GpsOrder | None) -> list[str]:
    """Fill in the position; the sentences of what was assumed."""
    if autel := _AUTEL.search(text):
        east, longitude, north, latitude, height = autel.groups()
        fields["longitude"] = float(longitude) * (1.0 if east == "E" else -1.0)
        fields["latitude"] = float(latitude) * (1.0 if north == "N" else -1.0)
        fields |= {"absolute_height": float(height), "relative_height": float(height)}
        return [_AUTEL_HEIGHT]
    found = _GPS.search(text)
    if found is None:
        return []
    kind, *numbers, unit = found.groups()
    one, other, third = (float(number) for number in numbers)
    # a third value with decimals is a height; satellites are counted in whole numbers
    is_height = bool(unit) or "." in numbers[2] or "e" in numbers[2].lower()
    told = order is not None or _DISTANCE.search(text) is not None
    latitude_first = order == "latitude_first" if told else is_height
    if abs(one) > 90.0 >= abs(other) or abs(other) > 90.0 >= abs(one):
        told, latitude_first = True, abs(other) > 90.0
    fields["latitude"], fields["longitude"] = (one, other) if latitude_first else (other, one)
    if kind == "RTK":
        fields |= {"horizontal_sd": _RTK_SD_M, "height_sd": _RTK_SD_M}
    elif not is_height and third < _FEW_SATELLITES:
        fields |= {"horizontal_sd": _POOR_SD_M, "height_sd": 1.5 * _POOR_SD_M}
    if not is_height or unit or kind == "RTK":
        return []
    # with an M it stays at 0.0 while the barometer climbs, so that is not used
    fields["absolute_height"] = third
    return [_THIRD_IS_HEIGHT] if told else [_LATITUDE_IS_FIRST, _THIRD_IS_HEIGHT]


def _focal_length_mm(text: str) -> float:
    """``240`` is 24.0 mm, ``24.00`` is 24 mm: a value without a point counts tenths."""
    value = _number(text)
    return value / 10.0 if text.isdigit() and value >= 100.0 else value


def _number(text: str) -> float:
    """A number, with a decimal comma too; NaN for what is none."""
    try:
        value = float(text.rstrip(",").replace(",", "."))
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan
