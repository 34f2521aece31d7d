"""Dates and times of day, as tables spell them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date, datetime
from functools import lru_cache

_DAY_NS = 86_400_000_000_000
_EPOCH_DAY = date(1970, 1, 1).toordinal()
_YEAR_FIRST = re.compile(r"(\d{4})[-/.:](\d{1,2})[-/.:](\d{1,2})")
_YEAR_LAST = re.compile(r"(\d{1,2})[-/.](\d{1,2})[-/.](\d{4}|\d{2})")
_COMPACT = re.compile(r"(\d{4})(\d{2})(\d{2})(?=T|\b)")
#: 14 Jun 2026, 14-Jun-26, Jun 14, 2026, perhaps behind a day of the week; months in English
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_MONTH = "(" + "|".join(_MONTHS) + r")[a-z]*\.?"
_NAMED_MONTH = re.compile(
    rf"(?:[a-z]{{3,9}},?\s+)?(?:(\d{{1,2}})[ -]{_MONTH}[ ,-]+(\d{{4}}|\d{{2}})|{_MONTH}\s+(\d{{1,2}}),?\s+(\d{{4}}))\b",
    re.IGNORECASE,
)
_TIME = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{1,2})(?:[.,:](\d{1,9}))?)?(?:\s*([AaPp])\.?[Mm]\.?)?")
_COMPACT_TIME = re.compile(r"(\d{2})(\d{2})(\d{2})(?:[.,](\d{1,9}))?()")
_ZONE = re.compile(r"(?:Z|UTC|GMT)|([+\-−])(\d{1,2}):?(\d{2})?")


@dataclass(frozen=True, slots=True)
class Moment:
    """day_ns: midnight, ns since 1970; None: a time of day alone. of_day_ns: since midnight; None: a date alone.

    utc_offset_ns: local minus UTC, where the text says its zone.
    """

    day_ns: int | None
    of_day_ns: int | None
    utc_offset_ns: int | None


def moment(text: str, month_first: bool, pattern: str | None = None) -> Moment | None:
    """What a cell says, or None if it is no date and no time. pattern: of ``strptime``, instead of guessing."""
    return _by_pattern(text.strip(), pattern) if pattern else _guessed(text.strip(), month_first)


def is_month_first(cells: Sequence[str]) -> tuple[bool, bool]:
    """Whether 06/14/2026 stands for June in these cells; and whether they leave that open.

    Dates with points have the day first. Others leave it open where no number is greater than 12.
    """
    found = [match for cell in cells if (match := _YEAR_LAST.match(cell.strip())) is not None]
    firsts = {int(match.group(1)) for match in found}
    seconds = {int(match.group(2)) for match in found}
    if not found or "." in found[0].group(0):
        return False, False
    if max(firsts) > 12:
        return False, False
    return True, max(seconds) <= 12 and firsts != seconds


def parse_utc_offset(text: str) -> int | None:
    """``utc`` or ``+02:00`` to ns; None if it is neither."""
    word = text.strip().upper()
    match = _ZONE.fullmatch(word.removeprefix("UTC").removeprefix("GMT") or "Z")
    return None if match is None else _offset_ns(match)


def _by_pattern(text: str, pattern: str) -> Moment | None:
    try:
        read = datetime.strptime(text, pattern)
    except (ValueError, OverflowError):
        return None
    of_day = ((read.hour * 60 + read.minute) * 60 + read.second) * 1_000_000 + read.microsecond
    offset = read.utcoffset()
    has_date = any(code in pattern for code in ("%Y", "%y", "%x", "%c", "%j"))
    has_time = any(code in pattern for code in ("%H", "%I", "%X", "%c"))
    return Moment(
        (read.toordinal() - _EPOCH_DAY) * _DAY_NS if has_date else None,
        of_day * 1000 if has_time else None,
        None if offset is None else round(offset.total_seconds() * 1e9),
    )


def _guessed(text: str, month_first: bool) -> Moment | None:
    day_ns, rest, compact = _leading_date(text, month_first)
    rest = rest.lstrip(" T\t,_")
    if not rest:
        return None if day_ns is None else Moment(day_ns, None, None)
    match = _TIME.match(rest) or (_COMPACT_TIME.match(rest) if compact else None)
    if match is None:
        return None
    of_day_ns = _of_day_ns(match)
    zone = rest[match.end() :].strip().upper()
    zone_match = _ZONE.fullmatch(zone)
    if of_day_ns is None or (zone and zone_match is None):
        return None
    return Moment(day_ns, of_day_ns, None if zone_match is None else _offset_ns(zone_match))


def _leading_date(text: str, month_first: bool) -> tuple[int | None, str, bool]:
    if (named := _NAMED_MONTH.match(text)) is not None:
        parts = [part for part in named.groups() if part is not None]
        order = "dmy" if parts[0].isdigit() else "mdy"
        numbers = tuple(p if p.isdigit() else str(_MONTHS.index(p[:3].lower()) + 1) for p in parts)
        day_ns = _day_ns(numbers, order)
        return day_ns, text[named.end() :] if day_ns is not None else text, False
    for pattern, order in (
        (_YEAR_FIRST, "ymd"),
        (_YEAR_LAST, "mdy" if month_first else "dmy"),
        (_COMPACT, "ymd"),
    ):
        if (match := pattern.match(text)) is not None:
            day_ns = _day_ns(match.groups(), order)
            if day_ns is not None:
                return day_ns, text[match.end() :], pattern is _COMPACT
    return None, text, False


@lru_cache(maxsize=1024)
def _day_ns(parts: tuple[str, ...], order: str) -> int | None:
    named = dict(zip(order, (int(part) for part in parts), strict=True))
    year = named["y"] + (2000 if named["y"] < 100 else 0)
    try:
        return (date(year, named["m"], named["d"]).toordinal() - _EPOCH_DAY) * _DAY_NS
    except ValueError:
        return None


def _of_day_ns(match: re.Match[str]) -> int | None:
    hour, minute, second = int(match.group(1)), int(match.group(2)), int(match.group(3) or 0)
    half = (match.group(5) or "").lower()
    if half:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + (12 if half == "p" else 0)
    if hour > 23 or minute > 59 or second > 60:
        return None
    fraction = int((match.group(4) or "").ljust(9, "0"))
    return ((hour * 60 + minute) * 60 + second) * 1_000_000_000 + fraction


def _offset_ns(match: re.Match[str]) -> int:
    if match.group(1) is None:
        return 0
    minutes = int(match.group(2)) * 60 + int(match.group(3) or 0)
    return (1 if match.group(1) == "+" else -1) * minutes * 60_000_000_000
