"""Which time of the video a sample of the telemetry belongs to, where the telemetry has a clock of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pipeline.config.telemetry import Angles, Telemetry
from pipeline.errors import InputError
from pipeline.ingest.track import Track
from pipeline.messages import FloatArray

#: a recording in a log is as long as its video but for so much: a log has a row each second, or ten
_LENGTH_SLACK_S = 2.5
#: a log that lasts as long as the video, to so much, began and ended with it
_SAME_LENGTH_S = 0.5


@dataclass(frozen=True, slots=True)
class Alignment:
    """offset_s: added to the track's times to get the video's. reason: how it is known, for the user."""

    offset_s: float
    reason: str = ""


def align(
    track: Track, telemetry: Telemetry, video_s: float, created_ns: int | None, where: object
) -> Alignment:
    """The alignment of a track with its video.

    video_s: its duration. created_ns: when it began by its own metadata, ns UTC, if it says so. Raises InputError
    if nothing tells the alignment, or if several recordings of the log fit the video.
    """
    if telemetry.time_offset is not None:
        return Alignment(telemetry.time_offset)
    if track.tied_to_video:
        return Alignment(0.0)
    by_date = _by_date(track, telemetry, created_ns)
    starts_s = recordings_s(track)
    fitting = [start for start, length in starts_s if abs(length - video_s) <= _LENGTH_SLACK_S]
    if by_date is not None and fitting:
        nearest = min(fitting, key=lambda start_s: abs(start_s + by_date))
        return Alignment(-nearest, "video starts with the log's recording that is nearest to its date")
    if len(fitting) == 1:
        return Alignment(-fitting[0], "video starts where the log says that recording began")
    if by_date is not None:
        return Alignment(by_date, "video starts at the date in its own metadata")
    span_s = float(track.times_s[-1] - track.times_s[0])
    if not starts_s and abs(span_s - video_s) <= _SAME_LENGTH_S:
        return Alignment(
            -float(track.times_s[0]), "the log lasts as long as the video, so they began together"
        )
    found = (
        f"{len(fitting)} recordings in the log that fit the video" if starts_s else "a log with its own clock"
    )
    expected = (
        "telemetry.time_offset, in seconds: the video's time of the log's time 0"
        if created_ns is None or track.clock != "local"
        else "telemetry.utc_offset or telemetry.time_offset"
    )
    raise InputError(where, f"{found}, of {span_s:.0f} s beside a video of {video_s:.0f} s", expected)


def on_the_videos_clock(angles: Track, stated: Angles, track: Track, alignment: Alignment) -> Track:
    """A track of angles with its times on the video's clock.

    track, alignment: of the positions. Raises InputError if neither the mission nor the dates of both tell it.
    """
    if stated.time_offset is not None or angles.tied_to_video:
        return replace(angles, times_s=angles.times_s + (stated.time_offset or 0.0))
    if "unknown" in (angles.clock, track.clock) or angles.clock != track.clock:
        found = f"angles whose clock is {angles.clock}, and positions whose clock is {track.clock}"
        raise InputError(stated.file, found, "telemetry.angles.time_offset")
    apart_s = (angles.start_time_ns - track.start_time_ns) * 1e-9
    first_s = float(track.times_s[0]) + alignment.offset_s + apart_s
    return replace(angles, times_s=angles.times_s - angles.times_s[0] + first_s)


def recordings_s(track: Track) -> list[tuple[float, float]]:
    """Start and length of each time in which the log says that the camera was recording."""
    if track.recording is None:
        return []
    on = np.concatenate([[False], np.nan_to_num(track.recording) > 0.5, [False]])
    edges = np.flatnonzero(np.diff(on.astype(np.int8)))
    times: FloatArray = track.times_s
    return [(float(times[a]), float(times[b - 1] - times[a])) for a, b in edges.reshape(-1, 2)]


def _by_date(track: Track, telemetry: Telemetry, created_ns: int | None) -> float | None:
    """The offset by the dates of log and video, if both are known in UTC and they meet."""
    if created_ns is None or track.clock == "unknown":
        return None
    if track.clock == "local" and telemetry.utc_offset is None:
        return None
    zone_s = 0.0 if track.clock == "utc" else telemetry.utc_offset or 0.0
    start_s = (track.start_time_ns - created_ns) * 1e-9 - zone_s - float(track.times_s[0])
    span_s = float(track.times_s[-1] - track.times_s[0])
    began_s = start_s + float(track.times_s[0])
    return start_s if math.isfinite(start_s) and began_s + span_s > 0.0 and abs(began_s) < 86_400.0 else None
