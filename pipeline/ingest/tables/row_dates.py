"""The dates of a table's rows: written out, counted since 1970, GPS weeks, or days of a spreadsheet."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.config.telemetry import Column
from pipeline.errors import InputError
from pipeline.ingest.tables.cells import numbers
from pipeline.ingest.tables.dates import Moment, is_month_first, moment, parse_utc_offset
from pipeline.ingest.tables.delimited import DelimitedTable
from pipeline.ingest.tables.units import factor, split_unit, unit_names
from pipeline.ingest.track import Clock
from pipeline.messages import FloatArray

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


@dataclass
class RowDates:
    """ns: int64 (N,), 0 where known is False; what a column of dates says before it is put on a clock."""

    ns: NDArray[np.int64]
    known: NDArray[np.bool_]
    clock: Clock
    assumed: list[str] = field(default_factory=list)

    @property
    def in_whole_seconds(self) -> bool:
        return bool(np.all(self.ns[self.known] % 1_000_000_000 == 0))


def row_dates(table: DelimitedTable, columns: dict[str, Column]) -> RowDates | None:
    """The dates of the rows, on UTC where the zone is known; None if the table has none."""
    if "time" not in columns:
        return None
    column, cells = columns["time"], cells_of(table, columns, "time")
    values = numbers(cells, table.decimal)
    if "gps_week" in columns:
        return _gps_dates(table, columns, values)
    epoch = epoch_of(values, column) if np.isfinite(values).mean() > 0.5 else None
    if epoch is not None:
        return _epoch_dates(values, cells, column, *epoch)
    return _written_dates(table, columns, cells)


def _gps_dates(table: DelimitedTable, columns: dict[str, Column], values: FloatArray) -> RowDates:
    weeks = numbers(cells_of(table, columns, "gps_week"), table.decimal)
    week_s = values * seconds_of(table, "time", columns["time"], values)
    utc_s = _GPS_EPOCH_S + weeks * _WEEK_S + week_s - _LEAP_S
    return _of_seconds(utc_s, [f"GPS time is {_LEAP_S:g} s ahead of UTC"])


def epoch_of(values: FloatArray, column: Column) -> tuple[float, float, str] | None:
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
) -> RowDates:
    assumed = [] if column.unit else [f"times are {name} since 1970 in UTC"]
    if zero_s == 0.0 and all(cell.lstrip("+-").isdigit() or not cell for cell in cells):
        # whole counts are exact in integers, where a float of nanoseconds is not
        per_count = round(scale * 1e9)
        known = np.array([bool(cell) and abs(int(cell)) * per_count < 9e18 for cell in cells])
        ns = np.array([int(c) * per_count if k else 0 for c, k in zip(cells, known, strict=True)], np.int64)
        return _shifted(RowDates(ns, known, "utc", assumed), column)
    return _shifted(_of_seconds(values * scale + zero_s, assumed), column)


def _of_seconds(seconds: FloatArray, assumed: list[str]) -> RowDates:
    known = np.isfinite(seconds) & (np.abs(seconds) < 9e9)
    whole = np.where(known, np.floor(seconds), 0.0)
    ns = whole.astype(np.int64) * 1_000_000_000
    # a float of seconds since 1970 is good to a quarter of a microsecond
    ns += np.round(np.where(known, seconds - whole, 0.0) * 1e6).astype(np.int64) * 1000
    return RowDates(ns, known, "utc", assumed)


def _shifted(dates: RowDates, column: Column) -> RowDates:
    """Numbers that count local time are rare, but may be stated."""
    offset_ns = _stated_offset_ns(column)
    if offset_ns is not None:
        dates.ns = np.where(dates.known, dates.ns - offset_ns, 0)
    return dates


def _written_dates(table: DelimitedTable, columns: dict[str, Column], cells: list[str]) -> RowDates | None:
    column = columns["time"]
    days = cells_of(table, columns, "date") if "date" in columns else cells
    month_first, open_question = is_month_first(days)
    moments = [moment_of(cell, column, month_first) for cell in cells]
    if "date" in columns:
        moments = [
            _with_day(m, moment_of(d, columns["date"], month_first))
            for m, d in zip(moments, days, strict=True)
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
) -> RowDates:
    offsets = np.array(
        [-1 if m is None or m.utc_offset_ns is None else m.utc_offset_ns for m in moments], np.int64
    )
    zoned = np.array([m is not None and m.utc_offset_ns is not None for m in moments])
    if zoned.all():
        ns[known] -= offsets
        return RowDates(ns, known, "utc", assumed)
    stated = _stated_offset_ns(column)
    if stated is None:
        assumed.append(
            "times are local, of a zone that the file does not say (utc_offset in the telemetry says it)"
        )
        return RowDates(ns, known, "local", assumed)
    ns[known] -= stated
    return RowDates(ns, known, "utc", assumed)


def _stated_offset_ns(column: Column) -> int | None:
    zone = column.zone or (split_unit(column.name)[1] if isinstance(column.name, str) else "")
    if column.zone is not None and parse_utc_offset(zone) is None and zone.lower() not in ("local", "video"):
        raise InputError("telemetry.columns.time.zone", repr(zone), "utc, local, or an offset such as +02:00")
    return parse_utc_offset(zone) if zone and zone.lower() != "video" else None


def moment_of(cell: str, column: Column, month_first: bool) -> Moment | None:
    pattern = column.unit if column.unit and "%" in column.unit else None
    return moment(cell, month_first, pattern)


def _head_unit(column: Column) -> str:
    return split_unit(column.name)[1] if isinstance(column.name, str) else ""


def cells_of(table: DelimitedTable, columns: dict[str, Column], quantity: str) -> list[str]:
    index = table.index(columns[quantity].name)
    return [] if index is None else table.column(index)


def seconds_of(table: DelimitedTable, quantity: str, column: Column, values: FloatArray) -> float:
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
