"""The rows of a table to a Track, by a map of its columns; a row that cannot be used costs that row."""

from __future__ import annotations

import numpy as np

from pipeline.config.telemetry import Column
from pipeline.config.terrain import Datum
from pipeline.ingest.samples import FIELDS, Sample, track_of
from pipeline.ingest.tables.columns import TableColumns, read_columns
from pipeline.ingest.tables.delimited import DelimitedTable, Row
from pipeline.ingest.tables.fix import fix_sd_m, without_fix
from pipeline.ingest.tables.sample_times import SampleTimes, sample_times
from pipeline.ingest.track import Track

_EXPECTED = "rows with a time and a position"
#: a row that ends before one of these was not written to its end
_NEEDED = ("latitude", "longitude", "absolute_height", "relative_height", "yaw", "pitch", "roll")


def track_of_table(
    table: DelimitedTable, columns: dict[str, Column], height_datum: Datum | None = None
) -> Track:
    """The samples of a table. columns: by quantity. height_datum: of absolute_height, if the format says it.

    Raises InputError if a column is not there, has no known unit, or no row can be used.
    """
    read = read_columns(table, columns)
    _widen_weak_fixes(read)
    times = sample_times(table, columns)
    return track_of(
        table.path,
        _samples(read, times),
        expected=_EXPECTED,
        clock=times.clock,
        left_out=table.left_out,
        tied_to_video=times.tied_to_video,
        height_datum=height_datum,
        camera_name=_camera_name(table, columns),
        assumed=(*read.assumed, *times.assumed),
    )


def _samples(read: TableColumns, times: SampleTimes) -> list[Sample]:
    """The rows that are whole and have a time; others are counted in the table."""
    table = read.table
    needed = max(table.index(read.columns[name].name) or 0 for name in _NEEDED if name in read.columns)
    no_fix = [False] * len(table.rows)
    if "latitude" in read.values:
        no_fix = without_fix(read.get("latitude"), read.get("longitude"), read.values, read.assumed).tolist()
    names = [name for name in FIELDS if name in read.values]
    cells = np.stack([read.values[name] for name in names], axis=1)
    held = np.isfinite(cells)
    samples = []
    for i, row in enumerate(table.rows):
        reason = _fault(row, needed, float(times.times_s[i]))
        if reason is not None:
            table.left_out.add(reason, table.where(row))
            continue
        time_s = float(times.times_s[i])
        values = {name: float(cells[i, k]) for k, name in enumerate(names) if held[i, k]}
        date_ns = None if times.clock == "unknown" else times.start_ns + round(time_s * 1e9)
        samples.append(Sample(table.where(row), time_s, values, date_ns, has_fix=not no_fix[i]))
    return samples


def _fault(row: Row, needed: int, time_s: float) -> str | None:
    if len(row.cells) <= needed:
        return "incomplete"
    return None if np.isfinite(time_s) else "no_time"


def _widen_weak_fixes(read: TableColumns) -> None:
    """Standard deviations from the kind of fix, where no column states them and the fix is a weak one."""
    if "horizontal_sd" in read.values:
        return
    horizontal_m = fix_sd_m(read.values)
    if horizontal_m is None:
        return
    read.values["horizontal_sd"] = horizontal_m
    read.values.setdefault("height_sd", 1.5 * horizontal_m)
    weak = int(np.isfinite(horizontal_m).sum())
    read.assumed.append(f"{weak} rows with a weak fix have a standard deviation of 2 to 10 m")


def _camera_name(table: DelimitedTable, columns: dict[str, Column]) -> str | None:
    index = table.index(columns["camera_name"].name) if "camera_name" in columns else None
    cells = [] if index is None else table.column(index)
    return next((cell for cell in cells if cell and not cell.isdigit()), None)
