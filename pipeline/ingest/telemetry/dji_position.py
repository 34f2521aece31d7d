"""The position in a cue of the dialects that write it in brackets: ``GPS(..)``, ``RTK(..)``.

``GPS(lon, lat, n)``  n counts satellites. ``RTK(lon, lat, n)``: the Phantom 4 RTK.
``GPS(lat, lon, h)``  the Matrice 300 (h with an M) and the Avata 2 (h with decimals): latitude first. But with
                      ``D ..m, H ..m`` beside it, as on the Phantom 4, longitude first whatever the third value is.
``GPS(W: lon, N: lat, hm)`` Autel; its letters say which is which.
"""

from __future__ import annotations

import re
from typing import Literal

from pipeline.ingest.telemetry.dji_numbers import FOOT_M, NUMBER, plain

GpsOrder = Literal["longitude_first", "latitude_first"]

_FIX = re.compile(r"\b(GPS|RTK)\s*:?\s*\(([^()]*)\)")
_PART = re.compile(rf"(?:([NSEW])\s*:?\s*)?({NUMBER})\s*(?:°|deg)?\s*(m|ft)?\s*([NSEW])?", re.IGNORECASE)
_DISTANCE = re.compile(rf"(?:^|[,\s])D(?:\s*[:=]\s*|\s+){NUMBER}\s*(?:m|ft)\b", re.MULTILINE)
LATITUDE_IS_FIRST = (
    "GPS(a, b, height) is latitude, longitude, height, as the Avata 2 writes it; if it is longitude first, say "
    "telemetry.gps_order: longitude_first"
)
LONGITUDE_IS_FIRST = (
    "GPS(a, b) is longitude, latitude, as most drones write it; if it is latitude first, say "
    "telemetry.gps_order: latitude_first"
)
THIRD_IS_HEIGHT = "the third value of GPS(a, b, height) is a height above the datum, not above take-off"
EITHER_HEIGHT = (
    "the height in GPS(.., .., height) is taken as the mission's telemetry.height says: absolute, above the datum; "
    "relative, above take-off (Autel does not say which it is)"
)
#: few satellites: metres of standard deviation; with RTK: decimetres
_FEW_SATELLITES, _POOR_SD_M, _RTK_SD_M = 6.0, 5.0, 0.1


def position_in(text: str, order: GpsOrder | None) -> tuple[dict[str, float], list[str]]:
    """Position, its deviation and perhaps a height, by the names of ``samples.FIELDS``; what was assumed.

    order: of ``GPS(a, b, ..)``, where the mission says it.
    """
    found = _FIX.search(text)
    if found is None:
        return {}, []
    kind, inner = found.groups()
    parts = [_PART.fullmatch(part.strip()) for part in _parts(inner)]
    if len(parts) not in (2, 3) or any(part is None for part in parts):
        return {}, []
    cells = [part.groups() for part in parts if part is not None]
    fields = _by_letters(cells)
    if fields is not None:
        if len(cells) == 2:
            return fields, []
        height_m = plain(cells[2][1]) * (FOOT_M if (cells[2][2] or "").lower() == "ft" else 1.0)
        return fields | {"absolute_height": height_m, "relative_height": height_m}, [EITHER_HEIGHT]
    return _by_order(text, kind, cells, order)


def _parts(inner: str) -> list[str]:
    """The values between the brackets; where commas stand for decimal points too, a space follows those between."""
    if ";" in inner:
        return inner.split(";")
    return re.split(r",\s+", inner.strip()) if inner.count(",") > 2 else inner.split(",")


def _by_letters(cells: list[tuple[str | None, ...]]) -> dict[str, float] | None:
    """Position by letters before or behind the values; None where they do not have them."""
    fields = {}
    for before, digits, _, after in cells[:2]:
        letter = (before or after or "").upper()
        name = {"N": "latitude", "S": "latitude", "E": "longitude", "W": "longitude"}.get(letter)
        if name is None or digits is None:
            return None
        value = plain(digits)
        # a minus beside W says the same again
        fields[name] = -abs(value) if letter in "SW" else value
    return fields if len(fields) == 2 else None


def _by_order(
    text: str, kind: str, cells: list[tuple[str | None, ...]], order: GpsOrder | None
) -> tuple[dict[str, float], list[str]]:
    one, other = (plain(cell[1] or "") for cell in cells[:2])
    third, unit = (cells[2][1] or "", cells[2][2]) if len(cells) == 3 else ("", None)
    # a third value with decimals is a height; satellites are counted in whole numbers
    is_height = bool(unit) or any(sign in third.lower() for sign in ".,e")
    told = order is not None or _DISTANCE.search(text) is not None
    latitude_first = order == "latitude_first" if told else is_height
    if abs(one) > 90.0 >= abs(other) or abs(other) > 90.0 >= abs(one):
        told, latitude_first = True, abs(other) > 90.0
    fields = (
        {"latitude": one, "longitude": other} if latitude_first else {"latitude": other, "longitude": one}
    )
    if kind == "RTK":
        fields |= {"horizontal_sd": _RTK_SD_M, "height_sd": _RTK_SD_M}
    elif third and not is_height and plain(third) < _FEW_SATELLITES:
        fields |= {"horizontal_sd": _POOR_SD_M, "height_sd": 1.5 * _POOR_SD_M}
    if not third:
        return fields, [] if told else [LONGITUDE_IS_FIRST]
    if not is_height or unit or kind == "RTK":
        # with an M it stays at 0.0 while the barometer climbs, so that is not used
        return fields, []
    fields["absolute_height"] = plain(third)
    return fields, [THIRD_IS_HEIGHT] if told else [LATITUDE_IS_FIRST, THIRD_IS_HEIGHT]
