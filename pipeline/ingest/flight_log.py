"""From the messages of an autopilot's log to a track: positions, attitudes and fixes come at rates of their own."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.config.terrain import Datum
from pipeline.ingest.attitude import Attitudes
from pipeline.ingest.samples import LeftOut, Sample, track_of
from pipeline.ingest.satellite_fix import FIX_3D, height_sd_m, horizontal_sd_m
from pipeline.ingest.track import Track
from pipeline.messages import FloatArray

#: a fix holds for so long, seconds: receivers report it once a second or more often
_FIX_HOLDS_S = 5.0
#: a clock that was never set by satellites counts from 1970 or 1980
_FIRST_DATE_S = 631_152_000.0  # 1990-01-01


@dataclass(frozen=True, slots=True, eq=False)
class Fixes:
    """What the receiver says, (N,) each: kind of fix, accuracies and dilutions; NaN where it does not."""

    times_s: FloatArray
    kind: FloatArray
    horizontal_accuracy_m: FloatArray
    vertical_accuracy_m: FloatArray
    hdop: FloatArray
    vdop: FloatArray


@dataclass
class FlightLog:
    """What was read. positions: columns by the names of ``samples.FIELDS``, degrees and metres, (N,) each.

    utc_offset_s: seconds since 1970 of the log's time 0, None if unknown. recording: times and 0 or 1.
    """

    times_s: FloatArray
    positions: Mapping[str, FloatArray]
    height_datum: Datum | None
    aircraft: Attitudes | None = None
    gimbal: Attitudes | None = None
    fixes: Fixes | None = None
    recording: tuple[FloatArray, FloatArray] | None = None
    utc_offset_s: float | None = None
    camera_name: str | None = None
    left_out: LeftOut = field(default_factory=LeftOut)
    assumed: list[str] = field(default_factory=list)


def track_of_log(path: object, log: FlightLog, expected: str, longest_gap_s: float) -> Track:
    """The track: a sample at each position, and at each angle of the gimbal between two positions.

    Angles are turned to the times of the positions, positions taken between their samples; neither over a gap.
    Raises InputError if no position can be used.
    """
    known_utc = log.utc_offset_s is not None and log.utc_offset_s + float(log.times_s[0]) > _FIRST_DATE_S
    date_ns = round((log.times_s[0] + log.utc_offset_s) * 1e9) if known_utc and log.utc_offset_s else None
    columns = dict(log.positions) | _fix_columns(log)
    samples = []
    for i, time_s in enumerate(log.times_s.tolist()):
        values = {name: float(column[i]) for name, column in columns.items() if not math.isnan(column[i])}
        has_fix = values.pop("fix", FIX_3D) >= FIX_3D
        at_ns = None if date_ns is None else date_ns + round((time_s - float(log.times_s[0])) * 1e9)
        samples.append(Sample(f"{path} at {time_s:.1f} s", time_s, values, at_ns, has_fix=has_fix))
    track = track_of(
        path,
        samples,
        expected=expected,
        clock="utc",
        left_out=log.left_out,
        tied_to_video=False,
        height_datum=log.height_datum,
        camera_name=log.camera_name,
        assumed=log.assumed,
    )
    return _with_recording(_with_attitudes(track, log, longest_gap_s), log)


def times_of_utc(times_s: FloatArray, utc_s: FloatArray) -> float | None:
    """Seconds since 1970 of time 0, the median over the pairs whose date was set; None if none was."""
    dated = np.isfinite(utc_s) & (utc_s > _FIRST_DATE_S) & np.isfinite(times_s)
    return float(np.median(utc_s[dated] - times_s[dated])) if dated.any() else None


def columns_of(rows: Sequence[Sequence[float]], width: int) -> list[FloatArray]:
    """Rows of a message to one array per field, each (N,)."""
    table = np.array(rows, np.float64).reshape(-1, width)
    return [table[:, k] for k in range(width)]


def _fix_columns(log: FlightLog) -> dict[str, FloatArray]:
    """The fix that held at each position, and the standard deviations that follow from it."""
    fixes = log.fixes
    if fixes is None or len(fixes.times_s) == 0:
        return {}
    order = np.argsort(fixes.times_s, kind="stable")
    times_s = fixes.times_s[order]
    last = np.clip(np.searchsorted(times_s, log.times_s, side="right") - 1, 0, len(times_s) - 1)
    held = np.abs(log.times_s - times_s[last]) <= _FIX_HOLDS_S

    def at(values: FloatArray) -> FloatArray:
        return np.where(held, values[order][last], math.nan)

    kind, hdop, vdop = at(fixes.kind), at(fixes.hdop), at(fixes.vdop)
    horizontal = horizontal_sd_m(kind, at(fixes.horizontal_accuracy_m), hdop)
    height = height_sd_m(kind, at(fixes.vertical_accuracy_m), vdop, hdop)
    unknown = np.isnan(kind)
    return {
        "fix": kind,
        "horizontal_sd": np.where(unknown, math.nan, horizontal),
        "height_sd": np.where(unknown, math.nan, height),
    }


def _with_attitudes(track: Track, log: FlightLog, longest_gap_s: float) -> Track:
    if log.gimbal is not None:
        track = _with_times_of(track, log.gimbal.ordered().times_s, longest_gap_s)
        angles = log.gimbal.at(track.times_s, longest_gap_s)
        track = replace(track, yaw_rad=angles[:, 0], pitch_rad=angles[:, 1], roll_rad=angles[:, 2])
    if log.aircraft is not None and len(log.aircraft.times_s):
        angles = log.aircraft.at(track.times_s, longest_gap_s)
        track = replace(
            track,
            aircraft_yaw_rad=angles[:, 0],
            aircraft_pitch_rad=angles[:, 1],
            aircraft_roll_rad=angles[:, 2],
        )
    return track


def _with_times_of(track: Track, added_s: FloatArray, longest_gap_s: float) -> Track:
    """The track with samples at more times, between two that it has and not over a gap."""
    own_s = track.times_s
    if len(own_s) < 2:
        return track
    inside = added_s[(added_s > own_s[0]) & (added_s < own_s[-1])]
    after = np.searchsorted(own_s, inside)
    inside = inside[own_s[after] - own_s[after - 1] <= longest_gap_s]
    times_s = np.union1d(own_s, inside)

    def between(values: FloatArray) -> FloatArray:
        if np.isinf(values).all():  # of a receiver that never had a fix; np.interp would make it unknown
            return np.full(len(times_s), math.inf)
        return np.asarray(np.interp(times_s, own_s, values))

    longitude = between(np.unwrap(track.longitude_deg, period=360.0))
    return replace(
        track,
        times_s=times_s,
        latitude_deg=between(track.latitude_deg),
        longitude_deg=np.mod(longitude + 180.0, 360.0) - 180.0,
        absolute_height_m=between(track.absolute_height_m),
        relative_height_m=between(track.relative_height_m),
        yaw_rad=np.full(len(times_s), math.nan),
        pitch_rad=np.full(len(times_s), math.nan),
        roll_rad=np.full(len(times_s), math.nan),
        horizontal_sd_m=None if track.horizontal_sd_m is None else between(track.horizontal_sd_m),
        height_sd_m=None if track.height_sd_m is None else between(track.height_sd_m),
    )


def _with_recording(track: Track, log: FlightLog) -> Track:
    """Recording is on from the message that says so until the one that says otherwise."""
    if log.recording is None or len(log.recording[0]) == 0:
        return track
    order = np.argsort(log.recording[0], kind="stable")
    times_s, on = log.recording[0][order], log.recording[1][order]
    last = np.searchsorted(times_s, track.times_s, side="right") - 1
    return replace(track, recording=np.where(last >= 0, on[np.clip(last, 0, None)], 0.0))
