"""Telemetry as subtitles, of DJI and Autel: a cue per picture, or per second, as a file beside the video."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.errors import InputError
from pipeline.ingest.samples import LeftOut, Sample, track_of
from pipeline.ingest.telemetry.dji_fields import date_ns
from pipeline.ingest.telemetry.dji_position import GpsOrder
from pipeline.ingest.telemetry.dji_shapes import CueReader
from pipeline.ingest.telemetry.dji_zoom import merge_zoom
from pipeline.ingest.telemetry.subtitles import TIME_LINE, Cue, cues_of
from pipeline.ingest.text import decoded, read_text
from pipeline.ingest.track import Track

EXPECTED = "DJI telemetry in SRT, with positions"
#: a last cue that much shorter than the one before was not written to its end, characters
_CUT_CHARACTERS = 8
#: a cue's time line stands in these first bytes and lines, below a counter, a mark or a title
_LOOKED_AT, _FIRST_LINES = 4096, 12


def is_dji_srt(path: Path, head: bytes) -> bool:
    """Whether a file is subtitles: by its name, or by a time line near its begin, whatever it is called."""
    return path.suffix.lower() == ".srt" or _begins_with_a_cue(decoded(head[:_LOOKED_AT]))


def _begins_with_a_cue(text: str) -> bool:
    return "-->" in text and any(TIME_LINE.fullmatch(line) for line in text.splitlines()[:_FIRST_LINES])


def read_dji_srt(path: Path, order: GpsOrder | None = None) -> Track:
    """The samples of a file. Raises InputError if none of them can be used.

    order: of ``GPS(a, b, height)``, where the file does not tell it.
    """
    text = read_text(path, EXPECTED)
    cues = cues_of(path, text)
    if not cues:
        raise InputError(path, "an empty file" if not text.strip() else "no cue", EXPECTED)
    cut = None if text.endswith("\n") or len(cues) < 2 else _cut_off(cues)
    return track_of_cues(path, cues if cut is None else cues[:-1], order, cut)


def track_of_cues(path: object, cues: Sequence[Cue], order: GpsOrder | None, cut: Cue | None = None) -> Track:
    """The track of cues, wherever they come from. cut: a cue that was not written to its end."""
    reader, left_out, assumed = CueReader(order), LeftOut(), dict[str, None]()
    fields: list[dict[str, float]] = []
    for cue in cues:
        values, of_cue = reader.fields(cue.text)
        fields.append(values)
        assumed.update(dict.fromkeys(of_cue))
    assumed.update(dict.fromkeys(merge_zoom(fields)))
    dates = [date_ns(cue.text) for cue in cues]
    samples = [
        Sample(cue.where, time_s, values if cue.text else {}, date, cue.end_s)
        for cue, time_s, values, date in zip(cues, _times_s(cues, dates), fields, dates, strict=True)
    ]
    if cut is not None:
        left_out.add("incomplete", cut.where)
    _require_positions(path, samples)
    return track_of(
        path, samples, expected=EXPECTED, clock="local", left_out=left_out, assumed=tuple(assumed)
    )


def _cut_off(cues: Sequence[Cue]) -> Cue | None:
    last, before = cues[-1], cues[-2]
    return last if len(last.text) < len(before.text) - _CUT_CHARACTERS else None


def _require_positions(path: object, samples: Sequence[Sample]) -> None:
    if not any("latitude" in s.values or "yaw" in s.values for s in samples):
        raise InputError(path, "subtitles without positions or gimbal angles", EXPECTED)


def _times_s(cues: Sequence[Cue], dates: Sequence[int | None]) -> list[float]:
    """Seconds since the video's start: of the time lines, or of the dates where there are none; NaN without."""
    if cues[0].start_s is not None:
        return [math.nan if cue.start_s is None else cue.start_s for cue in cues]
    known = [date for date in dates if date is not None]
    if not known:
        raise InputError(cues[0].where, "cues with neither a time line nor a date", EXPECTED)
    first_ns = known[0]
    times_s = np.array([math.nan if date is None else (date - first_ns) * 1e-9 for date in dates])
    return [float(t) for t in times_s]
