"""Which picture of which stream a listed row means: by number, by time, or by the name of a file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.geo.camera import Camera
from pipeline.ingest.tables.dates import moment
from pipeline.ingest.trajectory import Trajectory
from pipeline.messages import FloatArray
from pipeline.mission.frame_names import key_in, number_in, stream_of, time_in
from pipeline.mission.listed_frames import ListedRow, Listing

#: numbers from there on are dates, seconds since 1970
_EPOCH_S = 1e8


@dataclass(frozen=True, slots=True)
class Numbering:
    """What numbers of pictures count. first_frame: the number of a video's first picture; None: 0 or 1, found out.

    frame_rate: Hz at which the pictures were taken from the video; None: they are the video's own.
    """

    first_frame: int | None = None
    frame_rate: float | None = None


@dataclass(frozen=True, eq=False)
class FilmedStream:
    """times_s: presentation time of every picture, increasing. video: its file's name."""

    stream: str
    video: str
    times_s: FloatArray
    trajectory: Trajectory
    camera: Camera


@dataclass(frozen=True, eq=False)
class PictureFinder:
    """Finds the picture of a row; what it cannot find it counts. keys: what may stand for a stream."""

    listing: Listing
    streams: Mapping[str, FilmedStream]
    keys: Mapping[str, str]
    first_number: int
    numbering: Numbering

    def picture(self, row: ListedRow) -> tuple[str, int] | None:
        stream = self._stream(row)
        if stream is None:
            self.listing.leave_out("unknown stream", row.where)
            return None
        index = self._index(row, self.streams[stream])
        if isinstance(index, str):
            self.listing.leave_out(index, row.where)
            return None
        return stream, index

    def _stream(self, row: ListedRow) -> str | None:
        if row.stream:
            by_name = {key.lower(): stream for key, stream in self.keys.items()}
            return by_name.get(row.stream.lower())
        return stream_of(row.file, self.keys)

    def _index(self, row: ListedRow, filmed: FilmedStream) -> int | str:
        """The number of the picture in the video, or why there is none."""
        key = key_in(row.file, self.keys)
        if row.time:
            time_s = self._time_s(row.time, filmed)
            return "a time that cannot be read" if time_s is None else _nearest(filmed.times_s, time_s)
        if row.frame is None and row.file and (named_s := time_in(row.file, key)) is not None:
            return _nearest(filmed.times_s, named_s)
        number = row.frame if row.frame is not None else number_in(row.file, key)
        if number is None:
            return "neither number nor time in the file's name"
        number -= self.first_number
        if self.numbering.frame_rate is not None:
            return _nearest(filmed.times_s, number / self.numbering.frame_rate)
        return number if 0 <= number < len(filmed.times_s) else "outside of the video"

    def _time_s(self, text: str, filmed: FilmedStream) -> float | None:
        """Seconds of the video: as they are, or of a date."""
        try:
            value = float(text)
        except ValueError:
            read = moment(text, month_first=False)
            if (
                read is None
                or read.day_ns is None
                or read.of_day_ns is None
                or filmed.trajectory.clock == "unknown"
            ):
                return None
            date_ns = read.day_ns + read.of_day_ns - (read.utc_offset_ns or 0)
            return (date_ns - filmed.trajectory.utc_ns(0.0)) * 1e-9
        if value < _EPOCH_S:
            return value
        digits = 9 if value < 1e11 else 6 if value < 1e14 else 3 if value < 1e17 else 0
        return (round(value * 10**digits) - filmed.trajectory.utc_ns(0.0)) * 1e-9


def _nearest(times_s: FloatArray, time_s: float) -> int | str:
    """The picture that is nearest to a time, if one is within six tenths of the usual distance."""
    if not math.isfinite(time_s):
        return "a time that cannot be read"
    index = int(np.argmin(np.abs(times_s - time_s)))
    usual_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.1
    if abs(float(times_s[index]) - time_s) <= 0.6 * usual_s:
        return index
    outside = not times_s[0] <= time_s <= times_s[-1]
    return "outside of the video" if outside else "no picture at that time"


def stream_keys(streams: Sequence[FilmedStream]) -> dict[str, str]:
    """What may stand for a stream; a video's name that two streams share stands for none."""
    keys: dict[str, str] = {}
    for s in streams:
        for name in {s.video, s.video.rpartition(".")[0]} - {""}:
            keys[name] = "" if name in keys else s.stream
    keys = {name: stream for name, stream in keys.items() if stream}
    return keys | {s.stream: s.stream for s in streams}


def first_number(listing: Listing, streams: Sequence[FilmedStream], numbering: Numbering) -> int:
    """0 or 1: stated, or shown by the numbers themselves, or assumed."""
    if numbering.first_frame is not None:
        return numbering.first_frame
    keys = stream_keys(streams)
    rows = [row for row in (*listing.rows, *listing.pictures) if not row.time]
    read = [
        row.frame if row.frame is not None else number_in(row.file, key_in(row.file, keys)) for row in rows
    ]
    numbers = {n for n in read if n is not None}
    if not numbers or 0 in numbers:
        return 0
    longest = max(len(s.times_s) for s in streams)
    if numbering.frame_rate is None and longest in numbers:
        listing.assumed.append(f"frames are numbered from 1: the last of the video, {longest}, is listed")
        return 1
    listing.assumed.append("frames are numbered from 0 (else: --first-frame 1)")
    if (
        numbering.frame_rate is None
        and max(numbers) < 0.7 * longest
        and max(numbers) - min(numbers) < 2 * len(numbers)
    ):
        listing.assumed.append(
            f"frame numbers, up to {max(numbers)}, count the video's own {longest} pictures (else: --frame-rate)"
        )
    return 0
