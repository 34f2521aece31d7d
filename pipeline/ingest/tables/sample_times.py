"""The times of a table's rows: dates, time since some start, or both put together into one smooth clock."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.config.mission import Column
from pipeline.errors import InputError
from pipeline.ingest.tables.cells import numbers
from pipeline.ingest.tables.dates import Moment, is_month_first, moment, parse_utc_offset
from pipeline.ingest.tables.delimited import DelimitedTable
from pipeline.ingest.tables.units import factor, split_unit, unit_names
from pipeline.ingest.track import Clock
from pipeline.messages import FloatArray

_DAY_NS = 86_400_000_000_000
_WEEK_S = 604_800.0
#: 6 January 1980, and UTC behind GPS since 2017 (IERS bulletin C)
_GPS_EPOCH_S, _LEAP_S = 315_964_800.0, 18.0
#: 30 December 1899 to 1970, days of a spreadsheet
_SPREADSHEET_DAYS = 25_569.0
#: numbers greater than that are dates: 2001 in seconds, and so on; smaller ones count from some start
_EPOCHS = (
    (1e18, 1e-9, "nanoseconds"),
    (1e15, 1e-6, "microseconds"),
    (1e12, 1e-3, "milliseconds"),
    (1e9, 1.0, "seconds"),
)
_DURATION = r"(?:(\d+)h\s*)?(\d+)m\s*([\d.,]+)s"


@dataclass(frozen=True, eq=False)
class SampleTimes:
    """times_s: float64 (N,) since any start, NaN where a row has none. start_ns: the date of 0, on ``clock``.

    tied_to_video: 0 is the video's first picture. assumed: sentences.
    """

    times_s: FloatArray
    start_ns: int
    clock: Clock
    tied_to_video: bool = False
    assumed: tuple[str, ...] = ()


@dataclass
class _Dates:
    """ns: int64 (N,), 0 where known is False; what a column of dates says before it is put on a clock."""

    ns: NDArray[np.int64]
    known: NDArray[np.bool_]
    clock: Clock
    assumed: list[str] = field(default_factory=list)

    @property
    def in_whole_seconds(self) -> bool:
        return bool(np.all(self.ns[self.known] % 1_000_000_000 == 0))


def sample_times(table: DelimitedTable, columns: dict[str, Column]) -> SampleTimes:
    """The times by the columns ``time``, ``date``, ``elapsed`` and ``gps_week``, as far as there are any.

    Raises InputError if no row has a time.
    """
    dates = _dates(table, columns)
    elapsed_s = _elapsed_s(table, columns)
    if dates is None and elapsed_s is None:
        expected = "a column of times: dates, or seconds, milliseconds or H:M:S since some start"
        raise InputError(table.path, "no time in any row", expected)
    if dates is None:
        assert elapsed_s is not None
        tied = (columns.get("elapsed") or columns["time"]).zone == "video"
        return SampleTimes(elapsed_s, 0, "unknown", tied)
    if dates.in_whole_seconds and elapsed_s is not None:
        return _combined(dates, elapsed_s)
    first_ns = int(dates.ns[dates.known].min())
    times_s = np.where(dates.known, (dates.ns - first_ns) * 1e-9, math.nan)
    if dates.in_whole_seconds:
        times_s = _spread(times_s, dates)
    return SampleTimes(times_s, first_ns, dates.clock, assumed=tuple(dates.assumed))


def _combined(dates: _Dates, elapsed_s: FloatArray) -> SampleTimes:
    """Dates in whole seconds say when the finer clock was started.

    A date is the second that has begun: date <= start + elapsed < date + 1 for every row, so the start is
    known to about the time between two rows. Its earliest value is taken: a row falls on a full second.
    """
    both = dates.known & np.isfinite(elapsed_s)
    if not both.any():
        raise InputError("telemetry", "no row with a date and a time of flight", "some")
    first_ns = int(dates.ns[both].min())
    starts_s = (dates.ns[both] - first_ns) * 1e-9 - elapsed_s[both]
    earliest, latest = float(starts_s.max()), float(starts_s.min()) + 1.0
    assumed = list(dates.assumed)
    if earliest <= latest:
        start_s = earliest
        assumed.append(
            f"dates are in whole seconds: the clock is known to {max(latest - earliest, 0.001):.2g} s"
        )
    else:
        # the two clocks drift, or a row is wrong: the middle, which no single row can move
        start_s = float(np.median(starts_s)) + 0.5
        off_s = float(np.quantile(np.abs(starts_s + 0.5 - start_s), 0.9))
        assumed.append(
            f"dates in whole seconds and times of flight disagree by up to {off_s:.1f} s: the middle is taken"
        )
    return SampleTimes(elapsed_s, first_ns + round(start_s * 1e9), dates.clock, assumed=tuple(assumed))


def _spread(times_s: FloatArray, dates: _Dates) -> FloatArray:
    """Rows that share a whole second are spread evenly over it; the first second's rows end with it."""
    known = np.flatnonzero(dates.known)
    seconds, begins, counts = np.unique(times_s[known], return_index=True, return_counts=True)
    usual = int(np.median(counts))
    if usual < 2 or np.any(np.diff(times_s[known]) < 0):
        return times_s
    spread = times_s.copy()
    for number, (second, begin, count) in enumerate(zip(seconds, begins, counts, strict=True)):
        share = np.arange(count) / max(count, usual)
        late = 1.0 - count / max(count, usual) if number == 0 else 0.0
        spread[known[begin : begin + count]] = second + late + share
    dates.assumed.append(
        f"dates are in whole seconds, {usual} rows each: the rows are spread evenly over them"
    )
    return spread


def _elapsed_s(table: DelimitedTable, columns: dict[str, Column]) -> FloatArray | None:
    """Seconds since some start: of ``elapsed``, or of ``time`` if it holds no dates."""
    for quantity in ("elapsed", "time"):
        if quantity not in columns:
            continue
        column, cells = columns[quantity], _cells(table, columns, quantity)
        values = numbers(cells, table.decimal, "duration")
        if np.isfinite(values).any():
            if quantity == "time" and _epoch(values, column) is not None:
                return None
            return values * _seconds(table, quantity, column, values)
        values = np.array([_duration_s(cell) for cell in cells])
        if np.isfinite(values).any():
            return values
        if quantity == "time":
            return _times_of_day_s(cells, column)
    return None


def _seconds(table: DelimitedTable, quantity: str, column: Column, values: FloatArray) -> float:
    unit = column.unit or _head_unit(column)
    if not unit:
        raise InputError(
            f"{table.path} telemetry.columns.{quantity}.unit",
            f"no unit for times from {np.nanmin(values):g} to {np.nanmax(values):g}",
            f"one of {unit_names('duration')}",
        )
    scale = factor(unit, "duration")
    if scale is None:
        raise InputError(
            f"{table.path} telemetry.columns.{quantity}.unit", repr(unit), f"one of {unit_names('duration')}"
        )
    return scale


def _duration_s(cell: str) -> float:
    """``1m 23.4s``, as flight logs write their time of flight."""
    import re

    match = re.fullmatch(_DURATION, cell.strip())
    if match is None:
        return math.nan
    return (
        int(match.group(1) or 0) * 3600.0
        + int(match.group(2)) * 60.0
        + float(match.group(3).replace(",", "."))
    )


def _times_of_day_s(cells: list[str], column: Column) -> FloatArray | None:
    """H:M:S without a date, going on over midnight."""
    read = [_moment(cell, column, False) for cell in cells]
    values = np.array(
        [
            math.nan if m is None or m.of_day_ns is None or m.day_ns is not None else m.of_day_ns * 1e-9
            for m in read
        ]
    )
    if not np.isfinite(values).any():
        return None
    return _over_midnight(values)


def _over_midnight(values: FloatArray) -> FloatArray:
    known = np.flatnonzero(np.isfinite(values))
    falls = np.diff(values[known]) < -43_200.0
    result = values.copy()
    result[known[1:]] += 86_400.0 * np.cumsum(falls)
    return result


def _dates(table: DelimitedTable, columns: dict[str, Column]) -> _Dates | None:
    """The dates of the rows, on UTC where the zone is known; None if the table has none."""
    if "time" not in columns:
        return None
    column, cells = columns["time"], _cells(table, columns, "time")
    values = numbers(cells, table.decimal)
    if "gps_week" in columns:
        return _gps_dates(table, columns, values)
    epoch = _epoch(values, column) if np.isfinite(values).mean() > 0.5 else None
    if epoch is not None:
        return _epoch_dates(values, cells, column, *epoch)
    return _written_dates(table, columns, cells)


def _gps_dates(table: DelimitedTable, columns: dict[str, Column], values: FloatArray) -> _Dates:
    weeks = numbers(_cells(table, columns, "gps_week"), table.decimal)
    week_s = values * _seconds(table, "time", columns["time"], values)
    utc_s = _GPS_EPOCH_S + weeks * _WEEK_S + week_s - _LEAP_S
    return _of_seconds(utc_s, [f"GPS time is {_LEAP_S:g} s ahead of UTC"])


def _epoch(values: FloatArray, column: Column) -> tuple[float, float, str] | None:
    """Seconds per count, seconds of zero since 1970 and the unit, if numbers are dates."""
    unit = (column.unit or _head_unit(column)).lower()
    if unit in ("gps", "gps seconds", "gps_seconds"):
        return 1.0, _GPS_EPOCH_S - _LEAP_S, "GPS seconds"
    if unit in ("excel", "spreadsheet", "days"):
        return 86_400.0, -_SPREADSHEET_DAYS * 86_400.0, "days of a spreadsheet"
    middle = float(np.nanmedian(values)) if np.isfinite(values).any() else 0.0
    for least, seconds, name in _EPOCHS:
        stated = factor(unit, "duration")
        if middle >= least and (stated is None or stated == seconds):
            return seconds, 0.0, name
    return None


def _epoch_dates(
    values: FloatArray, cells: list[str], column: Column, scale: float, zero_s: float, name: str
) -> _Dates:
    assumed = [] if column.unit else [f"times are {name} since 1970 in UTC"]
    if zero_s == 0.0 and all(cell.lstrip("+-").isdigit() or not cell for cell in cells):
        # whole counts are exact in integers, where a float of nanoseconds is not
        per_count = round(scale * 1e9)
        known = np.array([bool(cell) and abs(int(cell)) * per_count < 9e18 for cell in cells])
        ns = np.array([int(c) * per_count if k else 0 for c, k in zip(cells, known, strict=True)], np.int64)
        return _shifted(_Dates(ns, known, "utc", assumed), column)
    return _shifted(_of_seconds(values * scale + zero_s, assumed), column)


def _of_seconds(seconds: FloatArray, assumed: list[str]) -> _Dates:
    known = np.isfinite(seconds) & (np.abs(seconds) < 9e9)
    whole = np.where(known, np.floor(seconds), 0.0)
    ns = whole.astype(np.int64) * 1_000_000_000
    # a float of seconds since 1970 is good to a quarter of a microsecond
    ns += np.round(np.where(known, seconds - whole, 0.0) * 1e6).astype(np.int64) * 1000
    return _Dates(ns, known, "utc", assumed)


def _shifted(dates: _Dates, column: Column) -> _Dates:
    """Numbers that count local time are rare, but may be stated."""
    offset_ns = _stated_offset_ns(column)
    if offset_ns is not None:
        dates.ns = np.where(dates.known, dates.ns - offset_ns, 0)
    return dates


def _written_dates(table: DelimitedTable, columns: dict[str, Column], cells: list[str]) -> _Dates | None:
    column = columns["time"]
    days = _cells(table, columns, "date") if "date" in columns else cells
    month_first, open_question = is_month_first(days)
    moments = [_moment(cell, column, month_first) for cell in cells]
    if "date" in columns:
        moments = [
            _with_day(m, _moment(d, columns["date"], month_first)) for m, d in zip(moments, days, strict=True)
        ]
    known = np.array([m is not None and m.day_ns is not None and m.of_day_ns is not None for m in moments])
    if not known.any():
        return None
    ns = np.array(
        [(m.day_ns or 0) + (m.of_day_ns or 0) if m and k else 0 for m, k in zip(moments, known, strict=True)],
        np.int64,
    )
    assumed = []
    if open_question and not (column.unit or "").count("%"):
        assumed.append(
            f"{days[int(np.argmax(known))]!r} has the month first (else: unit: '%d/%m/%Y %H:%M:%S')"
        )
    return _on_a_clock(ns, known, [m for m, k in zip(moments, known, strict=True) if k], column, assumed)


def _with_day(time: Moment | None, day: Moment | None) -> Moment | None:
    if time is None or day is None:
        return None
    return Moment(day.day_ns, time.of_day_ns, time.utc_offset_ns)


def _on_a_clock(
    ns: NDArray[np.int64],
    known: NDArray[np.bool_],
    moments: list[Moment | None],
    column: Column,
    assumed: list[str],
) -> _Dates:
    offsets = np.array(
        [-1 if m is None or m.utc_offset_ns is None else m.utc_offset_ns for m in moments], np.int64
    )
    zoned = np.array([m is not None and m.utc_offset_ns is not None for m in moments])
    if zoned.all():
        ns[known] -= offsets
        return _Dates(ns, known, "utc", assumed)
    stated = _stated_offset_ns(column)
    if stated is None:
        assumed.append(
            "times are local, of a zone that the file does not say (utc_offset in the telemetry says it)"
        )
        return _Dates(ns, known, "local", assumed)
    ns[known] -= stated
    return _Dates(ns, known, "utc", assumed)


def _stated_offset_ns(column: Column) -> int | None:
    zone = column.zone or (split_unit(column.name)[1] if isinstance(column.name, str) else "")
    if column.zone is not None and parse_utc_offset(zone) is None and zone.lower() not in ("local", "video"):
        raise InputError("telemetry.columns.time.zone", repr(zone), "utc, local, or an offset such as +02:00")
    return parse_utc_offset(zone) if zone and zone.lower() != "video" else None


def _moment(cell: str, column: Column, month_first: bool) -> Moment | None:
    pattern = column.unit if column.unit and "%" in column.unit else None
    return moment(cell, month_first, pattern)


def _head_unit(column: Column) -> str:
    return split_unit(column.name)[1] if isinstance(column.name, str) else ""


def _cells(table: DelimitedTable, columns: dict[str, Column], quantity: str) -> list[str]:
    index = table.index(columns[quantity].name)
    return [] if index is None else table.column(index)
