"""The telemetry of several recordings in a row, one file for each, as that of the stream that they make."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from pipeline.errors import InputError
from pipeline.ingest.track import Track
from pipeline.messages import FloatArray


def joined(tracks: Sequence[Track], starts_s: Sequence[float], where: object) -> Track:
    """One track of those of recordings that begin at starts_s, seconds of the stream's video, increasing.

    A sample that is still held when the next recording begins ends there. Raises InputError unless there is one
    track for each recording, each on its recording's clock.
    """
    if len(tracks) == 1:
        return tracks[0]
    if len(tracks) != len(starts_s):
        found = f"{len(tracks)} telemetry files for {len(starts_s)} recordings"
        raise InputError(where, found, "one for each recording, in their order, or one log of all")
    if not all(track.tied_to_video for track in tracks):
        found = "several telemetry files, of which one has a clock of its own"
        raise InputError(where, found, "subtitles of each recording, or one log of all")
    ends_s = [*starts_s[1:], np.inf]
    parts = [_until(t, end - start) for t, start, end in zip(tracks, starts_s, ends_s, strict=True)]
    columns = {f.name: _column([getattr(p, f.name) for p in parts], parts) for f in fields(Track)}
    arrays: dict[str, Any] = {name: values for name, values in columns.items() if values is not None}
    arrays["times_s"] = np.concatenate([p.times_s + s for p, s in zip(parts, starts_s, strict=True)])
    last = tracks[-1].end_s
    first_left_out: dict[str, str] = {}
    for track in reversed(tracks):
        first_left_out |= track.first_left_out
    return replace(
        tracks[0],
        **arrays,
        end_s=None if last is None else last + starts_s[-1],
        left_out=dict(sum((Counter(t.left_out) for t in tracks), Counter())),
        first_left_out=first_left_out,
        assumed=tuple(dict.fromkeys(text for t in tracks for text in t.assumed)),
    )


def _until(track: Track, end_s: float) -> Track:
    kept = track.times_s < end_s
    arrays: dict[str, Any] = {
        f.name: value[kept]
        for f in fields(track)
        if isinstance(value := getattr(track, f.name), np.ndarray) and len(value) == len(kept)
    }
    return replace(track, **arrays)


def _column(values: Sequence[Any], parts: Sequence[Track]) -> FloatArray | None:
    """The arrays in a row, NaN for a part without; None if it is no array in any."""
    if not any(isinstance(v, np.ndarray) for v in values):
        return None
    return np.concatenate(
        [np.full(len(p.times_s), np.nan) if v is None else v for v, p in zip(values, parts, strict=True)]
    )
