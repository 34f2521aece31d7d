"""The source stage: one video and its telemetry become the packets of the stream's substreams."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Protocol

import numpy as np

from pipeline.allocation.plan import Assignment
from pipeline.errors import RunFailedError
from pipeline.ingest.live.live_trajectory import LiveTrajectory
from pipeline.ingest.source import LostPicture, NothingYet, PassedPicture, Picture, Source, SourceInfo
from pipeline.ingest.trajectory import Trajectory
from pipeline.link.codec import Codec, Encoder
from pipeline.messages import EndOfStream, FloatArray, Frame, Message, Packet
from pipeline.mission.controller.substreams import Opened, PlanEpoch
from pipeline.mission.stages.kept_frames import RUN_S, KeptFrames


@dataclass(frozen=True)
class SourceParams:
    """max_backlog_s: a link that is further behind takes no new frame. most_age_s: nor is one sent that would be older
    than this before its first byte left: its result could only come too late. keyframe_interval_s: the longest that a
    decoder which joins late waits for a picture that stands alone. keep_bytes: of frames that no link could take, kept
    on the disk and sent later, see ``kept_frames``; wait_s: at the end of a stream they wait so long for a way.
    """

    max_backlog_s: float = 1.0
    most_age_s: float = math.inf
    keyframe_interval_s: float = 2.0
    keep_bytes: int = 0
    wait_s: float = 60.0

    def __post_init__(self) -> None:
        if not (self.max_backlog_s > 0.0 and self.most_age_s > 0.0 and self.keyframe_interval_s > 0.0):
            raise ValueError(f"{self}; expected times above 0")


#: why a frame was dropped that may have arrived all the same
LINK_LOST = "link_lost"
#: what another moment of the link may mend
_OF_THE_LINK = frozenset({"link_down", "link_full", "too_old"})
#: frames that were kept are sent while the link is not further behind, seconds
_KEPT_BACKLOG_S = 0.25
#: at the end of a stream the next run of them is sent after so long, if it could not be sent before
_AGAIN_S = 0.5


@dataclass(frozen=True, eq=False)
class StreamInput:
    """All that the source of one stream needs."""

    stream: str
    site: str
    source: Source
    trajectory: Trajectory | LiveTrajectory
    processing_rate_hz: float
    codec: Codec

    @property
    def video(self) -> SourceInfo:
        """What is known of its pictures."""
        return self.source.info

    @property
    def is_live(self) -> bool:
        """Whether its end is not known."""
        return self.video.duration_s is None

    @property
    def path(self) -> Path:
        """The first video file, or the first still; of a live stream what an error calls it."""
        return self.source.paths[0] if self.source.paths else Path(self.stream)

    @property
    def end_s(self) -> float:
        """Time of the video at which it ends; 0 of a live stream, as long as it flies."""
        return self.video.duration_s or 0.0

    @property
    def seconds_s(self) -> FloatArray:
        """A time for each second of the video that is used, (N,); of a live stream, of what was seen of it."""
        if self.is_live:
            first_s, last_s = self.trajectory.span_s
            return np.arange(first_s, max(last_s, first_s + 1e-3), 1.0)
        return np.arange(self.video.start_s, self.end_s, 1.0)

    @property
    def known_way(self) -> Trajectory:
        """The camera's way, of a live stream what is known of it."""
        return self.trajectory if isinstance(self.trajectory, Trajectory) else self.trajectory.newest

    @property
    def start_ns(self) -> int:
        """When the video starts, ns UTC."""
        return self.trajectory.utc_ns(0.0)


class Link(Protocol):
    """The way from a stream to the sites, as the source sees it."""

    def is_up(self, site: str, detector: str) -> bool:
        """Whether anything can be sent there now."""

    def backlog_s(self, site: str, now_s: float) -> float:
        """How long a message offered now would wait before its first byte is sent."""

    def send(self, site: str, detector: str, message: Message, now_s: float) -> bool:
        """Pass a message on; False if it was not taken. A Packet's link_s may be filled in."""

    def take_restarts(self) -> Collection[str]:
        """Detectors whose next packet must stand alone; each is told once."""

    def take_lost(self) -> Collection[Packet]:
        """Packets that were sent and may never have arrived; each is told once."""


@dataclass
class SourceCount:
    """Frames of one stream, as the source knows them.

    captured: in the video so far. lost: frame index -> why nobody could be sent it (``damaged``, ``missing``,
    ``no_pose``). due: frame index -> the detectors whose turn it was. dropped: (frame index, detector) -> why the
    frame was not sent. frames_dropped: frames that were sent to nobody, by reason, the lost ones too.
    """

    captured: int = 0
    lost: dict[int, str] = field(default_factory=dict)
    due: dict[int, tuple[str, ...]] = field(default_factory=dict)
    dropped: dict[tuple[int, str], str] = field(default_factory=dict)
    frames_dropped: Counter[str] = field(default_factory=Counter)

    @property
    def not_sampled(self) -> int:
        """Frames that are not on the processing clock."""
        return self.captured - len(self.due) - len(self.lost)

    def lose(self, index: int, reason: str) -> None:
        """Count a frame that nobody can be sent."""
        self.lost[index] = reason
        self.frames_dropped[reason] += 1

    def lose_sent(self, index: int, detector: str, reason: str) -> None:
        """Count a frame that was sent to a detector and may not have arrived; if it has, its result counts."""
        self.dropped[index, detector] = reason
        if all((index, d) in self.dropped for d in self.due[index]):
            self.frames_dropped[reason] += 1


class SourceStage:
    """Encodes every frame once for each substream that takes it, and offers it to the link.

    A frame is dropped *before* it is encoded, so that a decoder never misses a packet of its substream. Reasons:
    ``source_late``: it was read from the video too late. ``link_down``: the connection is broken or silent.
    ``link_full``: the link is too far behind. ``too_old``: both together make it older than a result may be.
    After it was encoded: ``receiver_busy``: the connection took no more; ``link_lost``: the connection broke.
    What a link could not take may be kept, and sent later.
    """

    def __init__(
        self,
        stream: StreamInput,
        assignments: tuple[Assignment, ...],
        link: Link,
        params: SourceParams | None = None,
    ) -> None:
        """assignments: what it begins with, epoch 0; those of other streams are left alone."""
        self.stream = stream
        self.count = SourceCount()
        self._link = link
        self._params = params or SourceParams()
        self._encoders: dict[str, Encoder] = {}
        self._since_key: dict[str, int] = {}
        self._kept = KeptFrames(
            self._params.keep_bytes,
            stream.processing_rate_hz,
            self._encoder,
            lambda frame, assignment, encoder: self._encode(frame, Opened(0, assignment), encoder, 0.0),
        )
        self._packets_sent: dict[str, int] = {}
        self._epoch = PlanEpoch(stream.stream, 0)
        self._begin(Opened(0, a) for a in assignments if a.stream == stream.stream)

    @property
    def epoch(self) -> PlanEpoch:
        """The epoch that it follows."""
        return self._epoch

    def follow(self, epoch: PlanEpoch, now_s: float) -> None:
        """Go over to another epoch, between two frames: no frame is sent under both.

        Substreams of both go on, with the phase of the new one; the others get their end, and new ones begin with a
        packet that stands alone. Raises RunFailedError, once all is done, for ends that could not be told.
        """
        left = [opened for opened in self._epoch.substreams if opened.key not in epoch.keys]
        kept = self._epoch.keys & epoch.keys
        # a switch waits for nobody: where the way is broken or full, the end is not told
        ready = [o for o in left if self._why_not(o.assignment, now_s, 0.0) is None]
        untold = self._tell_end(ready, now_s)
        untold += [f"{o.assignment.detector} at {o.assignment.site}" for o in left if o not in ready]
        self._epoch = replace(epoch, substreams=tuple(o for o in epoch.substreams if o.key in kept))
        self._begin(o for o in epoch.substreams if o.key not in kept)
        self._epoch = epoch
        self._require_told(untold)

    def _begin(self, substreams: Iterable[Opened]) -> None:
        for opened in substreams:
            assignment = opened.assignment
            self._begin_anew(assignment)
            self._packets_sent[assignment.detector] = 0
            self._epoch = replace(self._epoch, substreams=(*self._epoch.substreams, opened))

    @property
    def packets_sent(self) -> dict[str, int]:
        """Packets that were given to the link, by detector."""
        return dict(self._packets_sent)

    @property
    def kept(self) -> int:
        """Packets that wait for a link."""
        return len(self._kept)

    def run(
        self,
        wait_until: Callable[[float | None], float],
        pause: Callable[[float], float] | None = None,
    ) -> None:
        """Send the whole stream. wait_until(time since its start, s) returns the link's time when a frame is due.
        pause(seconds): the same after a while; without it what is kept is not sent after the end.

        A live stream's frames are due when they come, and None is waited for: not at all. What waited too long at its
        source is given up there.
        """
        for frame in self._frames_and_silence():
            if frame is None:
                wait_until(None)
                continue
            due_s = frame.time_s - self.stream.video.start_s
            now_s = wait_until(due_s)
            self.offer(frame, now_s, late_s=0.0 if self.stream.is_live else now_s - due_s)
        if pause is not None:
            self._send_the_rest(pause)
        self.end()

    def end(self) -> None:
        """Tell every detector that the stream is over. Raises RunFailedError for those that cannot be told."""
        self._give_up_what_is_kept()
        untold = self._tell_end(self._epoch.substreams, self.stream.end_s)
        self._hear()
        self._require_told(untold)

    def _tell_end(self, substreams: Iterable[Opened], now_s: float) -> list[str]:
        """Tell these detectors that nothing more comes; those that cannot be told."""
        untold = []
        for opened in substreams:
            detector, site = opened.assignment.detector, opened.assignment.site
            end = EndOfStream(self.stream.stream, detector, opened.epoch, self._packets_sent[detector])
            if not self._link.send(site, detector, end, now_s):
                untold.append(f"{detector} at {site}")
        return untold

    def _require_told(self, untold: list[str]) -> None:
        if untold:
            raise RunFailedError(f"stream {self.stream.stream}: its end did not reach {', '.join(untold)}")

    def frames(self) -> Iterator[Frame]:
        """The frames on the processing clock, with their poses."""
        return (frame for frame in self._frames_and_silence() if frame is not None)

    def _frames_and_silence(self) -> Iterator[Frame | None]:
        """As frames; None where a live stream has nothing yet."""
        for picture in self.stream.source.pictures(self.stream.processing_rate_hz):
            if isinstance(picture, NothingYet):
                yield None
                continue
            self.count.captured += 1
            if isinstance(picture, LostPicture):
                self.count.lose(picture.index, picture.reason)
            elif not isinstance(picture, PassedPicture):
                yield from self._with_pose(picture)

    def _with_pose(self, picture: Picture) -> Iterator[Frame]:
        trajectory = self.stream.trajectory
        pose = trajectory.pose(picture.time_s)
        if pose is None:
            self.count.lose(picture.index, "no_pose")
            return
        time_ns = trajectory.utc_ns(picture.time_s)
        yield Frame(
            self.stream.stream, picture.index, picture.tick, picture.time_s, time_ns, pose, picture.planes
        )

    def offer(self, frame: Frame, now_s: float, late_s: float = 0.0) -> None:
        """Encode and send the frame for each detector whose turn it is; late_s: since it was due."""
        self._hear()
        offered_s = time.perf_counter() - max(0.0, late_s)
        due = [o for o in self._epoch.substreams if frame.tick % o.assignment.period == o.assignment.phase]
        reasons = {o.assignment.detector: self._offer_to(frame, o, now_s, late_s, offered_s) for o in due}
        self.count.due[frame.index] = tuple(reasons)
        self.count.dropped.update({(frame.index, d): reason for d, reason in reasons.items() if reason})
        if all(reasons.values()):
            self.count.frames_dropped[next(iter(reasons.values()), None) or "not_assigned"] += 1

    def _offer_to(
        self, frame: Frame, opened: Opened, now_s: float, late_s: float, offered_s: float
    ) -> str | None:
        """Why the frame was neither sent nor kept, or None."""
        assignment = opened.assignment
        reason = self._why_not(assignment, now_s, late_s)
        if reason is None:
            if self._since_key.get(assignment.detector, 0) >= self._keyframe_interval(assignment):
                self._send_kept(opened, now_s)
            return self._send(frame, opened, now_s, offered_s)
        is_kept = reason in _OF_THE_LINK and self._kept.keep(frame, assignment, reason)
        return None if is_kept else reason

    def _send_kept(self, opened: Opened, now_s: float) -> int:
        """Send the oldest run that was kept for this detector, if its link has room; how many packets it had.

        What is filmed now begins with a picture that stands alone after it, as it would have done at this moment.
        """
        assignment = opened.assignment
        if not self._kept or self._link.backlog_s(assignment.site, now_s) > _KEPT_BACKLOG_S:
            return 0
        packets = self._kept.take(assignment)
        for packet in packets:
            self._send_kept_packet(packet, opened, now_s)
        if packets:
            self._begin_anew(assignment)
        return len(packets)

    def _send_kept_packet(self, packet: Packet, opened: Opened, now_s: float) -> None:
        assignment = opened.assignment
        sequence = self._packets_sent[assignment.detector]
        message = replace(packet, epoch=opened.epoch, sequence=sequence)
        if self._link.send(assignment.site, assignment.detector, message, now_s):
            self._packets_sent[assignment.detector] += 1
        else:
            self.count.lose_sent(packet.index, packet.detector, "link_down")

    def _send_the_rest(self, pause: Callable[[float], float]) -> None:
        """After the last frame: what was kept, no faster than it was filmed; not for ever, if there is no way."""
        waited_s = 0.0
        now_s = pause(0.0) if self._kept else 0.0
        while self._kept and waited_s < self._params.wait_s:
            self._hear()
            ready = [o for o in self._epoch.substreams if self._why_not(o.assignment, now_s, 0.0) is None]
            sent = sum(self._send_kept(opened, now_s) for opened in ready)
            waited_s = 0.0 if sent else waited_s + _AGAIN_S
            now_s = pause(RUN_S if sent else _AGAIN_S)

    def _give_up_what_is_kept(self) -> None:
        for (index, detector), reason in self._kept.give_up().items():
            self.count.lose_sent(index, detector, reason)

    def _begin_anew(self, assignment: Assignment) -> None:
        """The next packet stands alone."""
        self._encoders[assignment.detector] = self._encoder(assignment)
        self._since_key[assignment.detector] = 0

    def _hear(self) -> None:
        """What the link knows of what was sent before."""
        for packet in self._link.take_lost():
            self.count.lose_sent(packet.index, packet.detector, LINK_LOST)
        restarts = self._link.take_restarts()
        for opened in self._epoch.substreams:
            if opened.assignment.detector in restarts:
                self._begin_anew(opened.assignment)

    def _why_not(self, assignment: Assignment, now_s: float, late_s: float) -> str | None:
        """Why a frame need not even be encoded, or None."""
        if late_s > self._params.max_backlog_s:
            return "source_late"
        if not self._link.is_up(assignment.site, assignment.detector):
            return "link_down"
        backlog_s = self._link.backlog_s(assignment.site, now_s)
        if backlog_s > self._params.max_backlog_s:
            return "link_full"
        return "too_old" if late_s + backlog_s > self._params.most_age_s else None

    def _send(self, frame: Frame, opened: Opened, now_s: float, due_s: float) -> str | None:
        """Why the frame could not be sent, or None. due_s: when it was due, of ``time.perf_counter``."""
        assignment = opened.assignment
        packet = self._encode(frame, opened, self._encoders[assignment.detector], due_s)
        if self._link.send(assignment.site, assignment.detector, packet, now_s):
            self._packets_sent[assignment.detector] += 1
            since = self._since_key.get(assignment.detector, 0)
            self._since_key[assignment.detector] = 1 if packet.keyframe else since + 1
            return None
        # the decoder will miss this packet: the next one must stand alone
        self._begin_anew(assignment)
        return "receiver_busy" if self._link.is_up(assignment.site, assignment.detector) else "link_down"

    def _keyframe_interval(self, assignment: Assignment) -> int:
        """Packets of a substream from one that stands alone to the next."""
        rate_hz = self.stream.processing_rate_hz / assignment.period
        return max(1, round(self._params.keyframe_interval_s * rate_hz))

    def _encoder(self, assignment: Assignment, keyframe_interval: int | None = None) -> Encoder:
        rate_hz = self.stream.processing_rate_hz / assignment.period
        return Encoder(
            assignment.codec or self.stream.codec,
            *self.stream.source.sent_size,
            frame_rate_hz=rate_hz,
            bitrate_bps=assignment.bitrate_bps / assignment.period,
            keyframe_interval=keyframe_interval or self._keyframe_interval(assignment),
        )

    def _encode(self, frame: Frame, opened: Opened, encoder: Encoder, due_s: float) -> Packet:
        assignment = opened.assignment
        started = time.perf_counter()
        encoded = encoder.encode_frame(frame.planes, frame.tick // assignment.period)
        encode_s = time.perf_counter() - started
        source_s = max(0.0, started - due_s) if due_s else 0.0
        base = Fraction(assignment.period / self.stream.processing_rate_hz).limit_denominator(90_000)
        return Packet(
            stream=frame.stream,
            detector=assignment.detector,
            index=frame.index,
            time_ns=frame.time_ns,
            pts=encoded.pts,
            time_base_num=base.numerator,
            time_base_den=base.denominator,
            keyframe=encoded.keyframe,
            pose=frame.pose,
            data=encoded.data,
            encode_s=encode_s,
            width=self.stream.video.width,
            height=self.stream.video.height,
            epoch=opened.epoch,
            sequence=self._packets_sent[assignment.detector],
            source_s=source_s,
        )
