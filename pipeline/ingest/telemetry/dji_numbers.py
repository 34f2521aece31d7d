"""Numbers of subtitles, as people write them: with decimal commas, units, hemispheres and other minus signs."""

from __future__ import annotations

import math
import re

from pipeline.ingest.tables.cells import degrees

NUMBER = r"[-+\u2212]?(?:\d+(?:[.,]\d+|\.)?|\.\d+)(?:[eE][-+]?\d+)?"
#: a foot, metres
FOOT_M = 0.3048
_WITH_UNIT = re.compile(rf"([NSEWnsew])?\s*({NUMBER})\s*(mm|m|ft|feet|°|deg)?\s*([NSEWnsew])?", re.IGNORECASE)
_NEGATIVE = frozenset("SWsw")


def plain(text: str) -> float:
    """Of a text that NUMBER matches."""
    return float(text.replace(",", ".").replace("\u2212", "-"))


def number(text: str, unit: str | None = None, *, is_position: bool = False) -> float:
    """A number; metres where it is in feet; negative in the south and west. NaN for what is none.

    unit: that stands apart from it. is_position: degrees with minutes and seconds are understood.
    """
    match = _WITH_UNIT.fullmatch(text.rstrip(","))
    if match is None:
        return degrees(text) if is_position else math.nan
    before, digits, own, after = match.groups()
    value = plain(digits)
    if not math.isfinite(value):
        return math.nan
    if (own or unit or "").lower() in ("ft", "feet"):
        value *= FOOT_M
    letter = before or after or (unit if unit and len(unit) == 1 else "")
    return -abs(value) if letter and letter in _NEGATIVE else value
