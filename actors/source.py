"""The source actor: runs one stream's source stage in a thread."""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from actors.usage import Usage
from pipeline.allocation.plan import Assignment
from pipeline.clock import Clock
from pipeline.errors import RunFailedError, SearchlightError, failure
from pipeline.ingest.live.health import Health
from pipeline.ingest.live.live_trajectory import LiveTrajectory
from pipeline.ingest.live.source import LiveSource
from pipeline.link.keys import Endpoint, KeyPair
from pipeline.link.sender import LinkSender, LinkState
from pipeline.logs import Log, log_of_actor
from pipeline.messages import FloatArray, Message
from pipeline.mission.controller.events import LinkMeasure, SourceReport
from pipeline.mission.controller.orders import Send
from pipeline.mission.durable_reducer import Acknowledgement
from pipeline.mission.missing import WhatIsMissing
from pipeline.mission.stages.radio_link import RadioLink, RadioParams
from pipeline.mission.stages.source import SourceCount, SourceParams, SourceStage, StreamInput
from pipeline.mission.stages.virtual_link import VirtualLink, unlimited

_LOG = Log("actors")
Pace = Literal["realtime", "max"]


@dataclass(frozen=True)
class SourceStatus:
    """How far the source is.

    frames_done of frames_total frames of the video; sampled: on the processing clock, or lost; frames_dropped:
    sent to nobody, by reason. bytes_sent: per site. links: what is known of each site's link (realtime).
    packets_sent: by detector. reached_s: how much of the video was offered, seconds. finished: nothing more is sent.
    cut_off: since it was stopped. error: what went wrong, or None. epoch: of the plan that it follows.
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
    packets_sent: dict[str, int] = field(default_factory=dict)
    reached_s: float = 0.0
    cut_off: bool = False
    pid: int = field(default_factory=os.getpid)
    health: Health | None = None
    way: FloatArray | None = None
    epoch: int = 0
    usage: Usage = field(default_factory=Usage)


#: a link that takes all that it is offered may take so much more than was measured
_PROBE = 1.5


class _CutOffError(Exception):
    """The source was told to stop."""


class _OverError(Exception):
    """The operator has ended the stream."""


class SourceActor:
    """One stream. bandwidth_bps: of its link to every site that it sends to. Its key pair is made here, and stays
    here.
    """

    def __init__(
        self,
        stream: StreamInput,
        assignments: tuple[Assignment, ...],
        bandwidth_bps: Mapping[str, float],
        params: SourceParams,
        radio: RadioParams | None = None,
        clock: Clock | None = None,
    ) -> None:
        self._stream, self._params, self._radio = stream, params, radio or RadioParams()
        self._clock = clock or Clock()
        self._assignments = tuple(a for a in assignments if a.stream == stream.stream)
        self._bandwidth = bandwidth_bps
        self._keys = KeyPair()
        log_of_actor(f"source-{stream.stream}")
        self._finished = False
        self._error: SearchlightError | None = None
        self._stage: SourceStage | None = None
        self._bytes: dict[str, int] = {}
        self._link: RadioLink | None = None
        self._reached_s, self._flush_s = 0.0, math.inf
        self._stopped, self._cut_off = threading.Event(), False
        self._ordered, self._followed = threading.Lock(), -1
        self._order: tuple[Send, dict[str, Endpoint | None]] | None = None
        self._known: dict[tuple[str, int], Acknowledgement] = {}

    def public_key(self) -> bytes:
        """By which everybody knows it."""
        return self._keys.public

    def start(self, endpoints: Mapping[str, Endpoint], known: Sequence[Acknowledgement] = ()) -> None:
        """Send all as fast as it is taken (pace max). endpoints: by detector. known: what the reducer holds already,
        which is encoded again but not sent.
        """
        self._known = {(a.detector, a.epoch): a for a in known if a.stream == self._stream.stream}
        self._begin(lambda: self._run_max(endpoints))

    def film(self, start_time_s: float) -> None:
        """Send each frame when it is due (real time), to whom ``follow`` says. start_time_s: UTC, of time 0.

        Those of a live stream are due when they come.
        """
        self._begin(lambda: self._run_realtime(start_time_s))

    def stop(self, flush_s: float) -> None:
        """Take no further frame; what was taken is sent, at most for so long. The stream does not count as ended."""
        self._flush_s = flush_s
        self._stopped.set()

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
            packets_sent=self._stage.packets_sent if self._stage else {},
            reached_s=self._reached_s,
            cut_off=self._cut_off,
            epoch=max(self._followed, 0),
            health=self._stream.source.health if isinstance(self._stream.source, LiveSource) else None,
        )

    def way(self) -> FloatArray | None:
        """Of a live stream's camera, what was not reported yet, to its end."""
        way = self._stream.trajectory
        return way.take_rows(all_of_it=True) if isinstance(way, LiveTrajectory) else None

    def count(self) -> SourceCount:
        """What became of every frame, as the source knows it; call it when it is finished."""
        return self._stage.count if self._stage else SourceCount()

    def _begin(self, run: Callable[[], None]) -> None:
        threading.Thread(target=self._guard, args=(run,), daemon=True).start()

    def _guard(self, run: Callable[[], None]) -> None:
        try:
            run()
            self._finished = True
        except _CutOffError:
            self._cut_off = self._finished = True
        except Exception as error:
            self._error = failure(error)
            _LOG.warning("source failed", stream=self._stream.stream, error=str(self._error))

    def follow(self, order: Send, endpoints: Mapping[str, Endpoint | None]) -> None:
        """Go over to an epoch at the next frame; before the first one it is waited for. endpoints: by machine.

        An epoch that comes after one with a higher number changes nothing.
        """
        with self._ordered:
            if self._order is None or order.epoch.number >= self._order[0].epoch.number:
                self._order = order, dict(endpoints)

    def report(self, incarnation: int = 0) -> tuple[SourceReport, SourceStatus]:
        """Which epoch it follows and what its links let through, and a snapshot."""
        status, way = self.status(), self._stream.trajectory
        if isinstance(way, LiveTrajectory):
            status = replace(status, way=way.take_rows())
        measures = tuple(
            LinkMeasure(site, state.rate_bps * (1.0 if state.full else _PROBE))
            for site, state in status.links.items()
            if math.isfinite(self._bandwidth[site])
        )
        tick = status.frames_done
        ended = self._finished and not self._cut_off
        return SourceReport(self._stream.stream, incarnation, self._followed, tick, ended, measures), status

    def _run_realtime(self, start_time_s: float) -> None:
        link = RadioLink(self._stream.stream, self._bandwidth, self._keys, self._radio, self._clock)
        self._link = link
        start_s = self._clock.monotonic_of(start_time_s)
        stage = self._stage = SourceStage(self._stream, (), link, self._params)

        def wait_until(video_s: float | None) -> float:
            self._bytes = link.bytes_sent
            due_s = -math.inf if video_s is None or self._stream.is_live else start_s + video_s
            if self._stopped.wait(max(0.0, due_s - self._clock.monotonic_s())):
                raise _CutOffError
            self._reached_s = self._reached_s if video_s is None else video_s
            now_s = self._clock.monotonic_s() - start_s
            self._go_over(stage, link, now_s)
            return now_s

        def pause(seconds: float) -> float:
            if self._stopped.wait(seconds):
                raise _CutOffError
            return wait_until(None)

        try:
            stage.run(wait_until, pause)
        except _CutOffError:
            for sender in link.senders.values():
                sender.flush(self._flush_s)
            raise
        except _OverError:
            pass
        link.close()
        self._bytes = link.bytes_sent

    def _go_over(self, stage: SourceStage, link: RadioLink, now_s: float) -> None:
        """Follow the newest order, if it is not followed yet."""
        with self._ordered:
            order, self._order = self._order, None
        if order is None:
            return
        send, endpoints = order
        if send.epoch.number > self._followed:
            for opened in send.epoch.substreams:
                a = opened.assignment
                link.expect(a.site, a.detector, endpoints.get(a.machine))
            self._telling(lambda: stage.follow(send.epoch, now_s))
            self._followed = send.epoch.number
        if send.over:
            self._telling(stage.end)
            raise _OverError

    def _telling(self, act: Callable[[], None]) -> None:
        """An end that cannot be told is no failure here: the controller closes what is not drained, and counts it."""
        try:
            act()
        except RunFailedError as error:
            _LOG.warning("end not told", stream=self._stream.stream, error=str(error))

    def _run_max(self, endpoints: Mapping[str, Endpoint]) -> None:
        name = f"stream {self._stream.stream}"
        sender = LinkSender(unlimited(), capacity_bytes=self._radio.queue_bytes, keys=self._keys, name=name)
        for a in self._assignments:
            sender.connect(a.detector, endpoints[a.detector])

        def deliver(detector: str, message: Message) -> None:
            try:
                taken = sender.send(detector, message, self._radio.stalled_s)
            except ConnectionError as error:
                raise RunFailedError(f"stream {self._stream.stream}: {error}") from None
            self._require_read([] if taken else [detector])

        def wait_until(video_s: float | None) -> float:
            self._bytes = dict(link.bytes_sent)
            if self._stopped.is_set():
                raise _CutOffError
            self._reached_s = self._reached_s if video_s is None else video_s
            return self._reached_s

        link = VirtualLink(
            self._bandwidth, WhatIsMissing(deliver, self._is_known) if self._known else deliver
        )
        self._stage = SourceStage(self._stream, self._assignments, link, self._params)
        try:
            self._stage.run(wait_until)
        except _CutOffError:
            sender.flush(self._flush_s)
            raise
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

    def _is_known(self, message: Message) -> bool:
        said = self._known.get((message.detector, message.epoch))
        return said is not None and message.sequence in said
