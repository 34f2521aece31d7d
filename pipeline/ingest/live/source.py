"""A live stream as the source of a stream: its pictures come when they come."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from av.video.frame import VideoFrame
from numpy.typing import NDArray

from pipeline.config.live import Live
from pipeline.config.stream_url import StreamUrl
from pipeline.config.telemetry import Telemetry
from pipeline.ingest.finding import Finding
from pipeline.ingest.live.arrivals import Arrivals
from pipeline.ingest.live.health import Health
from pipeline.ingest.live.live_trajectory import LiveTrajectory
from pipeline.ingest.live.reader import LiveReader, Reading
from pipeline.ingest.live.recorder import Recorder, recorded_images
from pipeline.ingest.live.sampled_pictures import SampledPictures, Shape
from pipeline.ingest.live.telemetry_thread import TelemetryThread
from pipeline.ingest.source import LostPicture, NothingYet, PassedPicture, Picture, SourceInfo
from pipeline.messages import FloatArray

#: after so long without a picture whoever reads is told that there is none, seconds
_BEAT_S = 0.2
#: of a source whose process was replaced, pictures are numbered from here on; 92 hours at 30 a second
INDICES = 10_000_000


@dataclass
class _Running:
    reader: LiveReader | None = None


@dataclass(frozen=True, eq=False)
class LiveSource:
    """A Source without an end. name: of the stream. found: what is known of it, with the rate that it says.

    start_ns: its time 0, ns since 1970. way: grows while pictures are read. first: the picture that was looked at when
    the mission was prepared, and its time; it stays in the process that saw it. incarnation: how many processes read
    it before this one.
    """

    name: str
    url: StreamUrl
    live: Live
    telemetry: Telemetry
    found: SourceInfo
    sent_size: tuple[int, int]
    start_ns: int
    way: LiveTrajectory
    first: tuple[float, NDArray[np.uint8]] | None = None
    incarnation: int = 0
    findings: tuple[Finding, ...] = ()
    _running: _Running = field(default_factory=_Running, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"first": None, "_running": _Running()}

    @property
    def paths(self) -> tuple[Path, ...]:
        """It is read from no file."""
        return ()

    @property
    def info(self) -> SourceInfo:
        """Its pictures need not keep the rate."""
        return self.found

    @property
    def times_s(self) -> FloatArray:
        """Of the first picture, where it is known."""
        return np.array([] if self.first is None else [self.first[0]])

    def pictures(self, rate_hz: float) -> Iterator[Picture | LostPicture | PassedPicture | NothingYet]:
        """As Source says, as they come; without end, but where the sender ended it and does not come back.

        A picture waits until there is telemetry of its time, at most ``live.pose_wait``.
        """
        arrivals = Arrivals(self.start_ns)
        waiting = max(1, round(rate_hz * (self.live.pose_wait + 1.0)))
        size = self.found.width, self.found.height
        pictures = SampledPictures(Shape(size, self.sent_size, rate_hz, self.incarnation * INDICES, waiting))
        inside = self.telemetry.heard == self.url
        record = self.live.record
        told = Reading(
            self.name,
            self.url,
            self.live,
            arrivals,
            self.telemetry if inside else None,
            None if record is None else Recorder(self._kept(record), self.incarnation),
            on_track=self.way.extend,
        )
        beside = None if inside else TelemetryThread(self.telemetry, arrivals, self.way.extend)
        reader = self._running.reader = LiveReader(told, pictures)
        try:
            while not pictures.is_over:
                came = pictures.next(_BEAT_S)
                if came is None:
                    yield NothingYet()
                    continue
                arrival_s, item = came
                if isinstance(item, Picture):
                    until_s = arrival_s + self.live.pose_wait
                    self.way.wait_until_known(item.time_s, until_s - arrivals.now_s())
                yield item
        finally:
            reader.stop()
            if beside is not None:
                beside.stop()

    @property
    def health(self) -> Health:
        """How it is now."""
        reader = self._running.reader
        health = Health("waiting") if reader is None else reader.health
        return replace(health, pose_fault=self.way.fault)

    def planes_at(self, times_s: Iterable[float]) -> Iterator[tuple[float, VideoFrame]]:
        """Only the first picture is kept."""
        if self.first is not None and self.first[0] in set(times_s):
            frame = VideoFrame.from_ndarray(self.first[1], format="rgb24")
            size = self.sent_size
            yield (
                self.first[0],
                frame.reformat(*size, format="yuv420p", interpolation="AREA", dst_color_range=1),
            )

    def images_at(self, times_s: Iterable[float]) -> Iterator[tuple[float, NDArray[np.uint8]]]:
        """Of those that were recorded, on the node where they were."""
        if self.live.record is not None:
            size = self.found.width, self.found.height
            yield from recorded_images(self._kept(self.live.record), times_s, size)

    def _kept(self, record: Path) -> Path:
        """The folder of this flight: another one begins at another time."""
        return record / str(self.start_ns // 1_000_000)

    def exact_times_s(self) -> FloatArray:
        """As times_s."""
        return self.times_s

    def resized(self, width: int, height: int) -> LiveSource:
        """As Source says."""
        return replace(self, sent_size=(width, height))

    def again(self, incarnation: int) -> LiveSource:
        """As it is read by another process, after the one before was lost."""
        return replace(self, incarnation=incarnation)

    def flown(self, duration_s: float) -> LiveSource:
        """Once the mission is over: as long as it was."""
        return replace(self, found=replace(self.found, duration_s=duration_s))
