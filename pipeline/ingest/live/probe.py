"""What a live stream holds, by its first seconds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from av.video.frame import VideoFrame
from numpy.typing import NDArray

from pipeline.clock import Clock
from pipeline.config.live import Live
from pipeline.config.stream_url import StreamUrl
from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.live.arrivals import Arrivals
from pipeline.ingest.live.capture_clock import Basis
from pipeline.ingest.live.connection import Connection, Shown
from pipeline.ingest.live.reader import LiveReader
from pipeline.ingest.live.reader import Reading as Told
from pipeline.ingest.live.telemetry_thread import TelemetryThread
from pipeline.ingest.telemetry.misb_azimuth import Reading
from pipeline.ingest.track import Track
from pipeline.ingest.video.upright import upright_of

#: so long a stream is looked at, once it comes: for its rate, and to see what its clock is worth, seconds
_LOOK_S = 1.0
#: samples with a position that are enough to begin with
_LEAST_SAMPLES = 2
_BEAT_S = 0.05


@dataclass(frozen=True)
class Probed:
    """width, height: of the upright pictures. rate_hz: as they came. start_ns: time 0, that of the first picture, UTC.

    first: that picture, upright, uint8 (H, W, 3) RGB. track: the first telemetry, on the stream's clock. basis,
    refused_s: of the capture times, see CaptureClock. azimuth_reading: what angles in KLV count from; in flight
    that stays so.
    """

    width: int
    height: int
    rate_hz: float
    codec: str
    start_ns: int
    first: NDArray[np.uint8]
    track: Track
    basis: Basis
    refused_s: float
    azimuth_reading: Reading | None = None


class _Tracks:
    """The newest track of the stream's telemetry."""

    def __init__(self) -> None:
        self.newest: Track | None = None

    def take(self, track: Track) -> None:
        self.newest = track

    @property
    def is_enough(self) -> bool:
        return self.newest is not None and int(self.newest.has_position.sum()) >= _LEAST_SAMPLES


class _FirstPictures:
    """As Pictures says: keeps the first one that there is telemetry of, and counts from there."""

    def __init__(self, tracks: _Tracks) -> None:
        self.first: tuple[VideoFrame, Fraction | None, float] | None = None
        self.codec, self.count, self.span_s = "", 0, 0.0
        self._tracks, self._tracked = tracks, False

    def restart(self, connection: Connection) -> None:
        self.codec = connection.codec
        self.first, self._tracked = None, False

    def take(self, shown: Shown, time_s: float, connection: Connection) -> None:
        if shown.frame is None or not math.isfinite(shown.shown_s):
            return
        if not self._tracked:
            self.first, self.count = (shown.frame, connection.aspect, shown.shown_s), 0
            self._tracked = self._tracks.newest is not None
        self.count += 1
        self.span_s = shown.shown_s - self.first[2] if self.first is not None else 0.0

    def end(self) -> None:
        """Nothing is waited for."""


def probe_live(
    where: str, name: str, url: StreamUrl, live: Live, telemetry: Telemetry, clock: Clock | None = None
) -> Probed:
    """Look at a stream until there are pictures and positions, at most ``live.wait``. where: what an error names.

    Raises InputError with the reason, which is never the stream's password.
    """
    clock = clock or Clock()
    arrivals = Arrivals(clock.utc_ns(), clock)
    tracks = _Tracks()
    pictures = _FirstPictures(tracks)
    inside = telemetry.heard == url
    beside = None if inside else TelemetryThread(telemetry, arrivals, tracks.take)
    told = Told(name, url, live, arrivals, telemetry if inside else None, on_track=tracks.take)
    reader = LiveReader(told, pictures)
    try:
        _wait(pictures, tracks, reader, live.wait, arrivals.now_s, clock)
        return _probed(where, url, telemetry, pictures, tracks, reader, live, arrivals)
    finally:
        reader.stop()
        if beside is not None:
            beside.stop()


def _wait(
    pictures: _FirstPictures,
    tracks: _Tracks,
    reader: LiveReader,
    most_s: float,
    now_s: Callable[[], float],
    clock: Clock,
) -> None:
    until_s = now_s() + most_s
    while now_s() < until_s:
        if pictures.first is not None and pictures.span_s >= _LOOK_S and tracks.is_enough:
            return
        if reader.fault is not None and reader.fault.for_good:
            return
        clock.sleep(_BEAT_S)


def _probed(
    where: str,
    url: StreamUrl,
    telemetry: Telemetry,
    pictures: _FirstPictures,
    tracks: _Tracks,
    reader: LiveReader,
    live: Live,
    arrivals: Arrivals,
) -> Probed:
    if pictures.first is None:
        reason = str(reader.fault) if reader.fault is not None else f"nothing came within {live.wait:g} s"
        raise InputError(f"{where}.video", f"{url}: {reason}", "a stream that is sent now")
    frame, aspect, shown_s = pictures.first
    image = upright_of(frame, aspect).rgb(frame)
    zero_s = reader.clock.taken_s(shown_s)
    if tracks.newest is None or not tracks.is_enough:
        raise InputError(f"{where}.telemetry", *_no_position(url, telemetry, live, tracks))
    track = tracks.newest
    start_ns = arrivals.start_ns + round(zero_s * 1e9)
    times_s = track.times_s - zero_s
    moved = replace(
        track,
        times_s=times_s,
        start_time_ns=start_ns + round(float(times_s[0]) * 1e9),
        end_s=None if track.end_s is None else track.end_s - zero_s,
        clock="utc",
        tied_to_video=True,
    )
    rate_hz = (pictures.count - 1) / pictures.span_s if pictures.span_s > 0.0 else 1.0
    return Probed(
        image.shape[1], image.shape[0], rate_hz, pictures.codec, start_ns, image, moved, reader.clock.basis,
        reader.clock.refused_s,
        reader.azimuth_reading,
    )  # fmt: skip


def _no_position(url: StreamUrl, telemetry: Telemetry, live: Live, tracks: _Tracks) -> tuple[str, str]:
    if telemetry.heard == url:
        found = f"{url}: pictures, and no position in KLV beside them within {live.wait:g} s"
        return (
            found,
            "MISB ST 0601 in the stream, or telemetry.file: a udp:// port for MAVLink, or a file that grows",
        )
    if tracks.newest is not None and np.isnan(tracks.newest.latitude_deg).all():
        return f"{telemetry.file}: telemetry without positions", "a vehicle with a fix"
    return f"{telemetry.file}: no position within {live.wait:g} s", "telemetry that is sent, or written, now"
