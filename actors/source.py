"""The source actor: runs one stream's source stage in a thread."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from pipeline.allocation.plan import Assignment
from pipeline.clock import Clock
from pipeline.errors import RunFailedError, SearchlightError, failure
from pipeline.link.sender import LinkSender, LinkState
from pipeline.messages import Message
from pipeline.mission.stages.radio_link import RadioLink, RadioParams
from pipeline.mission.stages.source import SourceCount, SourceParams, SourceStage, StreamInput
from pipeline.mission.stages.virtual_link import VirtualLink, unlimited

Pace = Literal["realtime", "max"]
Address = tuple[str, int]


@dataclass(frozen=True)
class SourceStatus:
    """How far the source is.

    frames_done of frames_total frames of the video; sampled: on the processing clock, or lost; frames_dropped:
    sent to nobody, by reason. bytes_sent: per site. links: what is known of each site's link (realtime). error: what
    went wrong, or None.
    """

    stream: str
    frames_done: int
    frames_total: int
    finished: bool
    sampled: int
    frames_dropped: dict[str, int]
    bytes_sent: dict[str, int]
    error: SearchlightError | None
    links: dict[str, LinkState] = field(default_factory=dict)


class SourceActor:
    """One stream. bandwidth_bps: of its link to every site that it sends to."""

    def __init__(
        self,
        stream: StreamInput,
        assignments: tuple[Assignment, ...],
        bandwidth_bps: Mapping[str, float],
        token: bytes,
        params: SourceParams,
        radio: RadioParams | None = None,
        clock: Clock | None = None,
    ) -> None:
        self._stream, self._params, self._radio = stream, params, radio or RadioParams()
        self._clock = clock or Clock()
        self._assignments = tuple(a for a in assignments if a.stream == stream.stream)
        self._bandwidth = bandwidth_bps
        self._token = token
        self._finished = False
        self._error: SearchlightError | None = None
        self._stage: SourceStage | None = None
        self._bytes: dict[str, int] = {}
        self._link: RadioLink | None = None

    def start(self, addresses: Mapping[str, Address], pace: Pace, start_time_s: float) -> None:
        """Begin to send. addresses: by detector. start_time_s: UTC, when the first frame is due."""
        run = self._run_realtime if pace == "realtime" else self._run_max
        threading.Thread(target=self._guard, args=(run, addresses, start_time_s), daemon=True).start()

    def status(self) -> SourceStatus:
        """A snapshot."""
        count = self.count()
        return SourceStatus(
            stream=self._stream.stream,
            frames_done=count.captured,
            frames_total=self._stream.video.pictures or count.captured,
            finished=self._finished,
            sampled=len(count.due) + len(count.lost),
            frames_dropped=dict(count.frames_dropped),
            bytes_sent=dict(self._bytes),
            error=self._error,
            links=self._link.states() if self._link else {},
        )

    def count(self) -> SourceCount:
        """What became of every frame, as the source knows it; call it when it is finished."""
        return self._stage.count if self._stage else SourceCount()

    def _guard(
        self,
        run: Callable[[Mapping[str, Address], float], None],
        addresses: Mapping[str, Address],
        start_time_s: float,
    ) -> None:
        try:
            run(addresses, start_time_s)
            self._finished = True
        except Exception as error:
            self._error = failure(error)

    def _run_realtime(self, addresses: Mapping[str, Address], start_time_s: float) -> None:
        link = RadioLink(self._stream.stream, self._bandwidth, self._token, self._radio, self._clock)
        for a in self._assignments:
            link.connect(a.site, a.detector, addresses[a.detector])
        self._link = link
        start_s = self._clock.monotonic_of(start_time_s)

        def wait_until(video_s: float) -> float:
            self._bytes = link.bytes_sent
            self._clock.sleep(max(0.0, start_s + video_s - self._clock.monotonic_s()))
            return self._clock.monotonic_s() - start_s

        self._stage = SourceStage(self._stream, self._assignments, link, self._params)
        self._stage.run(wait_until)
        unread = link.close()
        self._bytes = link.bytes_sent
        self._require_read(unread)

    def _run_max(self, addresses: Mapping[str, Address], start_time_s: float) -> None:
        name = f"stream {self._stream.stream}"
        sender = LinkSender(unlimited(), capacity_bytes=self._radio.queue_bytes, name=name)
        for a in self._assignments:
            sender.connect(a.detector, addresses[a.detector], self._token)

        def deliver(detector: str, message: Message) -> None:
            try:
                taken = sender.send(detector, message, self._radio.stalled_s)
            except ConnectionError as error:
                raise RunFailedError(f"stream {self._stream.stream}: {error}") from None
            self._require_read([] if taken else [detector])

        def wait_until(video_s: float) -> float:
            self._bytes = dict(link.bytes_sent)
            return video_s

        link = VirtualLink(self._bandwidth, deliver)
        self._stage = SourceStage(self._stream, self._assignments, link, self._params)
        self._stage.run(wait_until)
        unread = (
            [] if sender.flush(self._radio.stalled_s) else sorted({a.detector for a in self._assignments})
        )
        sender.close()
        self._bytes = dict(link.bytes_sent)
        self._require_read(unread)

    def _require_read(self, unread: Sequence[str]) -> None:
        if unread:
            names = ", ".join(unread)
            raise RunFailedError(f"stream {self._stream.stream}: nothing more was read at {names}")
