"""The rows of a table to a Track, by a map of its columns; a row that cannot be used costs that row."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from pipeline.config.mission import Column, Datum
from pipeline.errors import InputError
from pipeline.ingest.tables.delimited import DelimitedTable
from pipeline.ingest.tables.fix import fix_sd_m, without_fix
from pipeline.ingest.tables.increasing import longest_increasing
from pipeline.ingest.tables.sample_times import sample_times
from pipeline.ingest.tables.samples import AIRCRAFT, CAMERA, Samples, read_samples
from pipeline.ingest.track import Track
from pipeline.messages import FloatArray

#: a row that lacks one of these is half written, if most other rows have it
_USUAL = ("absolute_height", "relative_height", *CAMERA)
#: heights beyond that are no flight over ground, metres
_LOWEST_M, _HIGHEST_M = -1000.0, 20_000.0
#: turns counted on past a full one are found in logs, more than two are not
_MOST_DEG = 720.0
_RAD = math.radians(1.0)


def track_of(table: DelimitedTable, columns: dict[str, Column], height_datum: Datum | None = None) -> Track:
    """The samples of a table. columns: by quantity. height_datum: of absolute_height, if the format says it.

    Raises InputError if a column is not there, has no known unit, or no row can be used.
    """
    samples = read_samples(table, columns)
    times = sample_times(table, columns)
    rows, left_out = _usable(samples, times.times_s)
    horizontal_sd_m, height_sd_m = _standard_deviations(samples, rows)
    recording = samples.chosen("recording", rows)
    times_s = times.times_s[rows]
    start_ns = times.start_ns + round(float(times_s[0]) * 1e9)
    return Track(
        start_time_ns=0 if times.clock == "unknown" else start_ns,
        times_s=times_s,
        latitude_deg=samples.get("latitude")[rows],
        longitude_deg=samples.get("longitude")[rows],
        absolute_height_m=samples.get("absolute_height")[rows],
        relative_height_m=samples.get("relative_height")[rows],
        yaw_rad=samples.get("yaw")[rows] * _RAD,
        pitch_rad=samples.get("pitch")[rows] * _RAD,
        roll_rad=samples.get("roll")[rows] * _RAD,
        clock=times.clock,
        tied_to_video=times.tied_to_video,
        height_datum=height_datum,
        aircraft_yaw_rad=samples.chosen("aircraft_yaw", rows, _RAD),
        aircraft_pitch_rad=samples.chosen("aircraft_pitch", rows, _RAD),
        aircraft_roll_rad=samples.chosen("aircraft_roll", rows, _RAD),
        focal_length_35mm=samples.chosen("focal_length_35mm", rows),
        horizontal_sd_m=horizontal_sd_m,
        height_sd_m=height_sd_m,
        attitude_sd_rad=samples.chosen("attitude_sd", rows, _RAD),
        recording=None if recording is None else np.nan_to_num(recording, nan=0.0),
        camera_name=_camera_name(table, columns),
        left_out=dict(left_out),
        assumed=(*samples.assumed, *times.assumed),
    )


def _usable(samples: Samples, times_s: FloatArray) -> tuple[NDArray[np.int64], Counter[str]]:
    """Numbers of the rows to keep, and why others are not kept."""
    left_out = Counter(samples.table.left_out)
    keep = np.ones(len(times_s), bool)

    def leave_out(where: NDArray[np.bool_], reason: str) -> None:
        if count := int(np.count_nonzero(keep & where)):
            left_out[reason] += count
            keep[where] = False

    latitude, longitude = samples.get("latitude"), samples.get("longitude")
    leave_out(_cut(samples), "half written")
    leave_out(~np.isfinite(times_s), "no time")
    leave_out(without_fix(latitude, longitude, samples.values, samples.assumed), "no fix")
    leave_out((np.abs(latitude) > 90.0) | (np.abs(longitude) > 180.0), "impossible")
    for name in ("absolute_height", "relative_height"):
        height_m = samples.get(name)
        leave_out((height_m < _LOWEST_M) | (height_m > _HIGHEST_M), "impossible")
    for name in (*CAMERA, *AIRCRAFT):
        leave_out(np.abs(samples.get(name)) > _MOST_DEG, "impossible")
    for name in _USUAL:
        lacking = np.isnan(samples.get(name))
        if keep.any() and np.mean(lacking[keep]) < 0.5:
            leave_out(lacking, "half written")
    return _in_order(np.where(keep, times_s, math.nan), samples.table, left_out), left_out


def _cut(samples: Samples) -> NDArray[np.bool_]:
    """Where a row ends before the last column that is needed of it."""
    needed = ("latitude", "longitude", *_USUAL)
    indices = [
        samples.table.index(samples.columns[name].name) or 0 for name in needed if name in samples.columns
    ]
    return np.array([len(row.cells) <= max(indices) for row in samples.table.rows], bool)


def _in_order(times_s: FloatArray, table: DelimitedTable, left_out: Counter[str]) -> NDArray[np.int64]:
    rows = longest_increasing(times_s)
    if not len(rows):
        reasons = ", ".join(f"{reason} {count}" for reason, count in left_out.items())
        found = f"no usable row of {len(table.rows)} ({reasons})"
        raise InputError(table.path, found, "rows with a time and a position")
    others = np.setdiff1d(np.flatnonzero(np.isfinite(times_s)), rows)
    repeated = int(np.isin(times_s[others], times_s[rows]).sum())
    for reason, count in (("repeated", repeated), ("out of order", len(others) - repeated)):
        if count:
            left_out[reason] += count
    return rows


def _standard_deviations(
    samples: Samples, rows: NDArray[np.int64]
) -> tuple[FloatArray | None, FloatArray | None]:
    """Horizontal and height: as the columns state them; else from the kind of fix, where it is a weak one."""
    horizontal_m, height_m = samples.chosen("horizontal_sd", rows), samples.chosen("height_sd", rows)
    if horizontal_m is None:
        horizontal_m = fix_sd_m({name: values[rows] for name, values in samples.values.items()})
        if horizontal_m is not None:
            weak = int(np.isfinite(horizontal_m).sum())
            samples.assumed.append(f"{weak} rows with a weak fix have a standard deviation of 2 to 10 m")
            height_m = 1.5 * horizontal_m if height_m is None else height_m
    return horizontal_m, height_m


def _camera_name(table: DelimitedTable, columns: dict[str, Column]) -> str | None:
    index = table.index(columns["camera_name"].name) if "camera_name" in columns else None
    cells = [] if index is None else table.column(index)
    return next((cell for cell in cells if cell and not cell.isdigit()), None)
