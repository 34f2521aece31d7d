"""DJI's subtitle telemetry: one SRT cue per frame (or second), in the dialects of its drones.

``[key: value]``    Mavic 2 and later, the enterprise drones: position, heights, gimbal angles, local time.
``GPS(lon,lat,n)``  older ones, with BAROMETER, Hb or H for the height; n counts satellites.
``GPS(lat,lon,zM)`` the Matrice 300: the only one with the latitude first, known by its M.

Local times are taken for UTC: the files do not say their zone.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import srt  # type: ignore[import-untyped]

from pipeline.errors import InputError
from pipeline.ingest.track import Track
from pipeline.messages import FloatArray

_EXPECTED = "DJI telemetry in SRT"
_BRACKET_FIELDS = {
    "latitude": "latitude",
    "longitude": "longitude",
    "longtitude": "longitude",  # so spelt by the Mavic 2
    "rel_alt": "relative_height",
    "abs_alt": "absolute_height",
    "altitude": "absolute_height",
    "gb_yaw": "yaw",
    "gb_pitch": "pitch",
    "gb_roll": "roll",
}
_FIELDS = tuple(dict.fromkeys(_BRACKET_FIELDS.values()))
_LIMITS = {"latitude": 90.0, "longitude": 180.0, "yaw": 360.0, "pitch": 360.0, "roll": 360.0}

_TAG = re.compile(r"<[^>]*>")
_BRACKET = re.compile(r"\[([^\]]*)\]")
_KEY_VALUE = re.compile(r"(\w+)\s*:\s*(\S+)")
_GPS = re.compile(r"GPS ?\(([^,)]*),([^,)]*),([^,)]*)\)")
_RELATIVE_HEIGHT = re.compile(r"(?:\bBAROMETER:|\bHb:|, H )([^\s,]*?)[Mm]?(?=[\s,]|$)")
_DATE = re.compile(r"(\d{4})[-.](\d{1,2})[-.](\d{1,2}) (\d{1,2}):(\d{2}):(\d{2})(?:[.,](\d+)(?:,(\d{3}))?)?")
_UNTIMED_CUE = re.compile(r"^\d+\n(.+?)(?=\n\s*\n|\n*\Z)", re.DOTALL | re.MULTILINE)


@dataclass(frozen=True, slots=True)
class _Cue:
    """where: file and line of the text. time_s: None in a dialect without a time line."""

    where: str
    time_s: float | None
    text: str


def read_dji_srt(path: Path) -> Track:
    """The samples of a file; a field that its dialect lacks is NaN throughout.

    Raises InputError with the line for text that is no telemetry, for a sample with other fields than
    the first, for positions without a GPS fix, and for times that do not increase.
    """
    cues = _without_repeats(list(_cues(path, _text(path))))
    if not cues:
        raise InputError(path, "no sample", _EXPECTED)
    samples = [_fields(cue) for cue in cues]
    _require_alike(cues, samples)
    columns = {name: np.array([s.get(name, math.nan) for s in samples], np.float64) for name in _FIELDS}
    start_ns = _utc_ns(cues[0])
    return Track(
        0 if start_ns is None else start_ns,
        _times_s(cues),
        columns["latitude"],
        columns["longitude"],
        columns["absolute_height"],
        columns["relative_height"],
        np.radians(columns["yaw"]),
        np.radians(columns["pitch"]),
        np.radians(columns["roll"]),
        clock="unknown" if start_ns is None else "utc",
    )


def is_dji_srt(path: Path, head: bytes) -> bool:
    """Whether a file is subtitles, by its name."""
    return path.suffix.lower() == ".srt"


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(path, "no file", _EXPECTED) from None
    except (OSError, UnicodeDecodeError):
        raise InputError(path, "a file that is not text", _EXPECTED) from None


def _cues(path: Path, text: str) -> Iterator[_Cue]:
    """The cues; the lines are counted here, since the srt package does not tell them."""
    if "-->" not in text:
        for match in _UNTIMED_CUE.finditer(text):
            yield _Cue(f"{path}:{_line(text, match.start(1))}", None, match.group(1))
        return
    position, line = 0, 1
    try:
        for subtitle in srt.parse(text):
            found = text.find(subtitle.content, position)
            line += text.count("\n", position, found)
            yield _Cue(f"{path}:{line}", subtitle.start.total_seconds(), subtitle.content)
            line += subtitle.content.count("\n")
            position = found + len(subtitle.content)
    except srt.SRTParseError as error:
        where = f"{path}:{_line(text, error.expected_start)}"
        raise InputError(where, "text that is not SRT", _EXPECTED) from None


def _line(text: str, position: int) -> int:
    return text.count("\n", 0, position) + 1


def _fields(cue: _Cue) -> dict[str, float]:
    """The known fields of a cue, degrees and metres."""
    text = _TAG.sub("", cue.text)
    fields = {
        _BRACKET_FIELDS[key]: _number(cue, key, value)
        for bracket in _BRACKET.findall(text)
        for key, value in _KEY_VALUE.findall(bracket)
        if key in _BRACKET_FIELDS
    }
    if gps := _GPS.search(text):
        one, other, third = (part.strip() for part in gps.groups())
        # the third value is not used: satellites, or a height that stays at 0.0M while the barometer climbs
        latitude, longitude = (one, other) if third.endswith("M") else (other, one)
        fields["latitude"] = _number(cue, "latitude", latitude)
        fields["longitude"] = _number(cue, "longitude", longitude)
    if height := _RELATIVE_HEIGHT.search(text):
        fields["relative_height"] = _number(cue, "height", height.group(1))
    _require_plausible(cue, fields)
    return fields


def _number(cue: _Cue, name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{cue.where} {name}", repr(text), "a number")
    return value


def _require_plausible(cue: _Cue, fields: dict[str, float]) -> None:
    for name, limit in _LIMITS.items():
        if abs(fields.get(name, 0.0)) > limit:
            raise InputError(f"{cue.where} {name}", f"{fields[name]:g}", f"at most {limit:g} degrees")
    if fields.get("latitude") == 0.0 and fields.get("longitude") == 0.0:
        raise InputError(cue.where, "latitude 0 and longitude 0", "a position with a GPS fix")


def _require_alike(cues: list[_Cue], samples: list[dict[str, float]]) -> None:
    for cue, sample in zip(cues, samples, strict=True):
        if odd := sorted(samples[0].keys() ^ sample.keys()):
            state = "with" if odd[0] in sample else "without"
            raise InputError(
                cue.where, f"a sample {state} {odd[0]}", "the same fields as in the first sample"
            )


def _without_repeats(cues: list[_Cue]) -> list[_Cue]:
    """Dates tick in seconds, as the samples do, but not quite together: two samples may show one second."""
    return [
        cue
        for i, cue in enumerate(cues)
        if i == 0 or cue.time_s is not None or _utc_ns(cue) != _utc_ns(cues[i - 1])
    ]


def _times_s(cues: list[_Cue]) -> FloatArray:
    """Seconds since the video's start, increasing; of the dates where the cues have no time."""
    times = [cue.time_s if cue.time_s is not None else _dated_s(cue, cues[0]) for cue in cues]
    for cue, before, after in zip(cues[1:], times, times[1:], strict=False):
        if after <= before:
            raise InputError(cue.where, f"{after:.3f} s after {before:.3f} s", "times that increase")
    return np.array(times, np.float64)


def _dated_s(cue: _Cue, first: _Cue) -> float:
    now_ns, start_ns = _utc_ns(cue), _utc_ns(first)
    if now_ns is None or start_ns is None:
        raise InputError(cue.where, "neither a time line nor a date", _EXPECTED)
    return (now_ns - start_ns) / 1e9


def _utc_ns(cue: _Cue) -> int | None:
    date = _DATE.search(cue.text)
    if date is None:
        return None
    try:
        whole = datetime(*(int(part) for part in date.groups()[:6]), tzinfo=UTC)  # type: ignore[arg-type,misc]
    except ValueError:
        raise InputError(cue.where, repr(date.group()), "a date") from None
    fraction = ((date.group(7) or "") + (date.group(8) or "")).ljust(9, "0")[:9]
    return int(whole.timestamp()) * 1_000_000_000 + int(fraction)
