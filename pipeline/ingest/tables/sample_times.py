"""The times of a table's rows: dates, time since some start, or both put together into one smooth clock."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from pipeline.config.telemetry import Column
from pipeline.errors import InputError
from pipeline.ingest.tables.cells import numbers
from pipeline.ingest.tables.delimited import DelimitedTable
from pipeline.ingest.tables.row_dates import RowDates, cells_of, epoch_of, moment_of, row_dates, seconds_of
from pipeline.ingest.track import Clock
from pipeline.messages import FloatArray

#: a fraction tells minutes and seconds from hours and minutes
_MINUTES = r"(\d{1,4}):([0-5]\d[.,]\d+)"
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


def sample_times(table: DelimitedTable, columns: dict[str, Column]) -> SampleTimes:
    """The times by the columns ``time``, ``date``, ``elapsed`` and ``gps_week``, as far as there are any.

    Raises InputError if no row has a time.
    """
    dates = row_dates(table, columns)
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


def _combined(dates: RowDates, elapsed_s: FloatArray) -> SampleTimes:
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


def _spread(times_s: FloatArray, dates: RowDates) -> FloatArray:
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
        column, cells = columns[quantity], cells_of(table, columns, quantity)
        values = numbers(cells, table.decimal, "duration")
        if np.isfinite(values).any():
            if quantity == "time" and epoch_of(values, column) is not None:
                return None
            return values * seconds_of(table, quantity, column, values)
        values = np.array([_duration_s(cell) for cell in cells])
        if np.isfinite(values).any():
            return values
        if quantity == "time":
            return _times_of_day_s(cells, column)
    return None


def _duration_s(cell: str) -> float:
    """``1m 23.4s``, as flight logs write their time of flight."""
    match = re.fullmatch(_DURATION, cell.strip())
    if match is None:
        minutes = re.fullmatch(_MINUTES, cell.strip())
        return math.nan if minutes is None else 60.0 * int(minutes[1]) + float(minutes[2].replace(",", "."))
    return (
        int(match.group(1) or 0) * 3600.0
        + int(match.group(2)) * 60.0
        + float(match.group(3).replace(",", "."))
    )


def _times_of_day_s(cells: list[str], column: Column) -> FloatArray | None:
    """H:M:S without a date, going on over midnight."""
    read = [moment_of(cell, column, False) for cell in cells]
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
