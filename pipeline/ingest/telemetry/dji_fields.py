"""What drones write in one cue of their subtitles, in the dialects of DJI and Autel.

``[key: value]``      Mavic 2 and later, the enterprise drones: position, heights, gimbal angles, focal length.
``GPS(..)``, ``RTK(..)``: see ``dji_position``.
``BAROMETER:``, ``Hb:``, ``H``: height above take-off. ``BAROMETER(..)`` is not: on the Avata 2 it falls as the drone
climbs. ``G.PRY``, ``F.PRY``: pitch, roll and yaw of the gimbal and of the aircraft, degrees.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from functools import lru_cache

from pipeline.ingest.telemetry.dji_numbers import FOOT_M, NUMBER, number, plain
from pipeline.ingest.telemetry.dji_position import GpsOrder, position_in

#: without what differs between writers: letter case, underscores. altitude: see EITHER_ALTITUDE
_NAMED = {
    **dict.fromkeys(("latitude", "lat"), "latitude"),
    # longtitude is how the Mavic 2 spells it
    **dict.fromkeys(("longitude", "longtitude", "lon", "lng", "long"), "longitude"),
    **dict.fromkeys(("relalt", "relativealtitude"), "relative_height"),
    **dict.fromkeys(("absalt", "absolutealtitude"), "absolute_height"),
    **dict.fromkeys(("altitude", "alt"), "altitude"),
    **dict.fromkeys(("gbyaw", "gimbalyaw"), "yaw"),
    **dict.fromkeys(("gbpitch", "gimbalpitch"), "pitch"),
    **dict.fromkeys(("gbroll", "gimbalroll"), "roll"),
    "droneyaw": "aircraft_yaw",
    "dronepitch": "aircraft_pitch",
    "droneroll": "aircraft_roll",
    **dict.fromkeys(("focallen", "focallength"), "focal_length_35mm"),
    **dict.fromkeys(("dzoomratio", "dzoom", "digitalzoom"), "digital_zoom"),
}
EITHER_ALTITUDE = (
    "altitude is taken as the mission's telemetry.height says: absolute, above the datum; relative, above take-off "
    "(drones differ in what they mean by it)"
)
_POSITION = frozenset({"latitude", "longitude"})
_HEIGHTS = frozenset({"altitude", "relative_height", "absolute_height"})
#: a comma inside of a value is a decimal one; a unit or a hemisphere may stand apart
KEY_VALUE = re.compile(
    r"([A-Za-z_]\w*)\s*[:=]\s*((?:[NSEW]\s)?[^\s\]\[,]+(?:,\d[^\s\]\[,]*)*)(?:\s(ft|feet|[NSEW])\b)?"
)
_PRY = re.compile(r"\b([GF])\.PRY\s*:?\s*\(([^()]*)\)")
_ANGLE = re.compile(rf"({NUMBER})\s*(?:°|deg)?")
_RELATIVE_HEIGHT = re.compile(
    rf"(?:\bBAROMETER\s*[:=]|\bHb\s*[:=]|(?:^|[,\s])H(?:\s*[:=]|\s))\s*({NUMBER})\s*(m|ft|feet)?(?=[\s,;)\]]|$)",
    re.MULTILINE | re.IGNORECASE,
)
_ZOOM = re.compile(rf"\bDZOOM\s+({NUMBER})")
_DATE = re.compile(
    r"(?:(\d{4})[-./](\d{1,2})[-./](\d{1,2})|(\d{1,2})\.(\d{1,2})\.(\d{4}))"
    r"[ T]+(\d{1,2}):(\d{2}):(\d{2})(?:[.,:](\d+)(?:,(\d{3}))?)?(?:\s*([AaPp])\.?[Mm]\b)?"
)
#: no lens is longer, millimetres of equivalent focal length; a whole picture has a zoom of 10000 in some dialects
_TENTHS_FROM_MM, _WHOLE_PICTURE = 100.0, 10_000.0


def fields_of(text: str, order: GpsOrder | None = None) -> tuple[dict[str, float], list[str]]:
    """The fields of a cue by the names of ``samples.FIELDS``, NaN for a value that is no number; what was assumed.

    order: of ``GPS(a, b, h)``, where the mission says it.
    """
    fields: dict[str, float] = {}
    for key, value, unit in KEY_VALUE.findall(text):
        name = field_name(key)
        if name is not None:
            fields[name] = reading(name, value, unit)
    assumed: list[str] = []
    # words first: a search for a pattern that is not there costs more than all else in a long file
    if "GPS" in text or "RTK" in text:
        position, assumed = position_in(text, order)
        fields |= position
    if "PRY" in text:
        _angles(text, fields)
    if "DZOOM" in text and "digital_zoom" not in fields and (zoom := _ZOOM.search(text)):
        fields["digital_zoom"] = plain(zoom.group(1))
    if "relative_height" not in fields and (height := _RELATIVE_HEIGHT.search(text)):
        metres = 1.0 if (height.group(2) or "m").lower() == "m" else FOOT_M
        fields["relative_height"] = plain(height.group(1)) * metres
    return fields, [*assumed, *altitude_by_kind(fields)]


def date_ns(text: str) -> int | None:
    """The date in a cue, ns since 1970 as if it were UTC; None if there is none, or none that exists."""
    date = _DATE.search(text)
    if date is None:
        return None
    year, month, day, first, second_of_date, last, hour, *rest = date.groups()
    minute, second, fraction, more, half = rest
    if year is None:
        year, month, day = last, second_of_date, first
    day_s = _day_s(int(year), int(month), int(day))
    hours = int(hour)
    if half is not None:
        if not 1 <= hours <= 12:
            return None
        hours = hours % 12 + (12 if half in "pP" else 0)
    if day_s is None or hours > 23 or int(minute) > 59 or int(second) > 59:
        return None
    nanoseconds = int(((fraction or "") + (more or "")).ljust(9, "0")[:9])
    return (day_s + 3600 * hours + 60 * int(minute) + int(second)) * 1_000_000_000 + nanoseconds


@lru_cache(maxsize=64)
def _day_s(year: int, month: int, day: int) -> int | None:
    try:
        return int(datetime(year, month, day, tzinfo=UTC).timestamp())
    except ValueError:
        return None


@lru_cache(maxsize=1024)
def field_name(key: str) -> str | None:
    """The field that a key names; None: one that is not used."""
    return _NAMED.get(key.lower().replace("_", ""))


def reading(name: str, text: str, unit: str) -> float:
    """The value of a field: metres, degrees, millimetres; NaN for a text that is no number. unit: that stands apart."""
    if not unit and text.isascii() and not text.isalpha():
        try:
            value = float(text)
        except ValueError:
            value = number(text, is_position=name in _POSITION)
    else:
        value = number(text, unit if name in _POSITION | _HEIGHTS else None, is_position=name in _POSITION)
    # 240 is 24.0 mm, 24.00 is 24 mm: a value without a point counts tenths
    if name == "focal_length_35mm":
        return value / 10.0 if text.isdigit() and value >= _TENTHS_FROM_MM else value
    if name == "digital_zoom":
        return value / _WHOLE_PICTURE if value >= _WHOLE_PICTURE else value
    return value


def _angles(text: str, fields: dict[str, float]) -> None:
    for kind, inner in _PRY.findall(text):
        # where commas stand for decimal points too, a space follows those between
        parts = re.split(r"[;,]\s+" if inner.count(",") > 2 else "[;,]", inner.strip())
        angles = [_ANGLE.fullmatch(part.strip()) for part in parts]
        if len(angles) == 3 and all(angles):
            prefix = "" if kind == "G" else "aircraft_"
            for name, angle in zip(("pitch", "roll", "yaw"), angles, strict=True):
                fields[prefix + name] = plain(angle.group(1)) if angle else 0.0


def altitude_by_kind(fields: dict[str, float]) -> list[str]:
    """Replace ``altitude``, if there is one: beside a height of known kind it is the other, alone it may be either."""
    altitude = fields.pop("altitude", None)
    if altitude is None or "absolute_height" in fields:
        return []
    fields["absolute_height"] = altitude
    if "relative_height" in fields:
        return ["altitude is a height above the datum, not above take-off"]
    fields["relative_height"] = altitude
    return [EITHER_ALTITUDE]
