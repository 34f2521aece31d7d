"""Which telemetry belongs to which video: by what is in them, not only by their names."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment

from pipeline.ingest.track import Track
from pipeline.ingest.video.file import VideoInfo

#: weights of the evidence against a pair; a name says less than a length or a date that does not fit
_OTHER_NAME, _OTHER_FOLDER = 1.0, 0.3
#: a video's own track is believed before a file beside it that fits no better, and is of no other video
_BESIDE, _OF_ANOTHER_VIDEO = 0.01, 1000.0
#: a subtitle file ends with its video, but for a cue
_LENGTH_TOLERANCE_S = 1.2
#: local time is off by whole quarters of an hour; clocks of camera and drone by seconds
_ZONE_STEP_S, _DATE_TOLERANCE_S = 900.0, 5.0
_MOST = 10.0
#: a pair that has so much against it is none; of one name it takes length and date together
_NO_PAIR, _NO_PAIR_OF_ONE_NAME = 9.5, 15.0


@dataclass(frozen=True, slots=True)
class Pair:
    """video: number in the list. telemetry: its file, or None. reason: why, where the names say something else."""

    video: int
    telemetry: Path | None
    reason: str = ""


def pair(
    videos: Sequence[VideoInfo], telemetry: Mapping[Path, Track], created_ns: Sequence[int | None]
) -> list[Pair]:
    """The pairs with the least evidence against them, one for each video.

    telemetry: by its file; that of a video's own tracks by the video. created_ns: when each video began by its own
    metadata, ns since 1970; None where it does not say.
    """
    paths = list(telemetry)
    of_videos = {video.path for video in videos}
    if not paths:
        return [Pair(k, None) for k in range(len(videos))]
    cost = np.array(
        [
            [
                _OF_ANOTHER_VIDEO
                if path in of_videos and path != video.path
                else against(video, path, telemetry[path], began)
                for path in paths
            ]
            for video, began in zip(videos, created_ns, strict=True)
        ]
    )
    chosen = dict(zip(*(x.tolist() for x in linear_sum_assignment(cost)), strict=True))
    return [
        _pair(k, video, paths, chosen.get(k), cost[k].tolist(), telemetry) for k, video in enumerate(videos)
    ]


def against(video: VideoInfo, path: Path, track: Track, created_ns: int | None) -> float:
    """How much speaks against a pair: 0 is nothing, each kind of evidence adds at most _MOST."""
    name = 0.0 if path.stem.lower() == video.path.stem.lower() else _OTHER_NAME
    folder = 0.0 if path.parent == video.path.parent else _OTHER_FOLDER
    beside = 0.0 if path == video.path else _BESIDE
    return name + folder + beside + _length(video, track) + _date(track, created_ns)


def span_of(track: Track) -> float:
    """Seconds from the first sample to the end of the last one."""
    return float((track.times_s[-1] if track.end_s is None else track.end_s) - track.times_s[0])


def _length(video: VideoInfo, track: Track) -> float:
    span_s = span_of(track)
    if not track.tied_to_video:  # a flight log may hold much more than the recording, not less
        return _MOST if span_s + _LENGTH_TOLERANCE_S < video.duration_s else 0.0
    excess_s = max(0.0, abs(span_s - video.duration_s) - _LENGTH_TOLERANCE_S)
    return min(_MOST, 2.0 * excess_s)


def _date(track: Track, created_ns: int | None) -> float:
    if created_ns is None or track.clock == "unknown":
        return 0.0
    off_s = (track.start_time_ns - created_ns) * 1e-9
    if not track.tied_to_video and off_s < 0.0:
        return 0.0  # the log began before the recording, as it should
    if abs(off_s) > 15 * 3600.0:
        return _MOST
    beyond_zone_s = abs(math.remainder(off_s, _ZONE_STEP_S))
    return min(_MOST, max(0.0, beyond_zone_s - _DATE_TOLERANCE_S))


def _pair(
    number: int,
    video: VideoInfo,
    paths: list[Path],
    chosen: int | None,
    cost: list[float],
    telemetry: Mapping[Path, Track],
) -> Pair:
    if chosen is None:
        return Pair(number, None)
    path = paths[chosen]
    one_name = path.stem.lower() == video.path.stem.lower()
    if cost[chosen] >= (_NO_PAIR_OF_ONE_NAME if one_name else _NO_PAIR):
        return Pair(number, None)
    namesake = next((k for k, p in enumerate(paths) if p.stem.lower() == video.path.stem.lower()), None)
    if namesake is None or namesake == chosen:
        return Pair(number, path)
    spans = [span_of(telemetry[p]) for p in (path, paths[namesake])]
    reason = (
        f"by length and date, not by name: {path.name} covers {spans[0]:.1f} s and {paths[namesake].name} "
        f"{spans[1]:.1f} s of a video of {video.duration_s:.1f} s"
    )
    return Pair(number, path, reason)
