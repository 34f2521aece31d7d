"""The source stage: one video and its telemetry become the packets of the stream's substreams."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Protocol

from pipeline.allocation.plan import Assignment
from pipeline.ingest.source import LostPicture, PassedPicture, Picture, Source, SourceInfo
from pipeline.ingest.trajectory import Trajectory
from pipeline.link.codec import Codec, Encoder
from pipeline.messages import EndOfStream, Frame, Message, Packet

#: a decoder that joins late or lost a packet waits at most so long for a picture that stands alone
KEYFRAME_INTERVAL_S = 2.0


@dataclass(frozen=True, eq=False)
class StreamInput:
    """All that the source of one stream needs."""

    stream: str
    site: str
    source: Source
    trajectory: Trajectory
    processing_rate_hz: float
    codec: Codec

    @property
    def video(self) -> SourceInfo:
        """What is known of its pictures."""
        return self.source.info

    @property
    def path(self) -> Path:
        """The first video file, or the first still."""
        return self.source.paths[0]

    @property
    def end_s(self) -> float:
        """Time of the video at which it ends."""
        return self.video.duration_s or 0.0

    @property
    def start_ns(self) -> int:
        """When the video starts, ns UTC."""
        return self.trajectory.utc_ns(0.0)


class Link(Protocol):
    """The way from a stream to the sites, as the source sees it."""

    def backlog_s(self, site: str, now_s: float) -> float:
        """How long a message offered now would wait before its first byte is sent."""

    def send(self, site: str, detector: str, message: Message, now_s: float) -> bool:
        """Pass a message on; False if there is no room for it. A Packet's link_s may be filled in."""


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


class SourceStage:
    """Encodes every frame once for each substream that takes it, and offers it to the link.

    A frame is dropped *before* it is encoded, so that a decoder never misses a packet of its substream.
    max_backlog_s: a link that is further behind than this takes no new frame (reason ``link_full``).
    """

    def __init__(
        self, stream: StreamInput, assignments: tuple[Assignment, ...], link: Link, max_backlog_s: float
    ) -> None:
        self.stream = stream
        self.assignments = tuple(a for a in assignments if a.stream == stream.stream)
        self.count = SourceCount()
        self._link = link
        self._max_backlog_s = max_backlog_s
        self._encoders = {a.detector: self._encoder(a) for a in self.assignments}
        self._packets_sent = {a.detector: 0 for a in self.assignments}

    def run(self, wait_until: Callable[[float], float]) -> None:
        """Send the whole stream. wait_until(time since its start, s) returns the link's time when a frame is due."""
        for frame in self.frames():
            due_s = frame.time_s - self.stream.video.start_s
            now_s = wait_until(due_s)
            self.offer(frame, now_s, late=now_s - due_s > self._max_backlog_s)
        self.end()

    def end(self) -> None:
        """Tell every detector that the stream is over."""
        for assignment in self.assignments:
            sent = self._packets_sent[assignment.detector]
            end = EndOfStream(self.stream.stream, assignment.detector, sequence=sent)
            self._link.send(assignment.site, assignment.detector, end, self.stream.end_s)

    def frames(self) -> Iterator[Frame]:
        """The frames on the processing clock, with their poses."""
        for picture in self.stream.source.pictures(self.stream.processing_rate_hz):
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

    def offer(self, frame: Frame, now_s: float, late: bool = False) -> None:
        """Encode and send the frame for each detector whose turn it is."""
        due = [a for a in self.assignments if frame.tick % a.period == a.phase]
        reasons = {a.detector: "source_late" if late else self._send(frame, a, now_s) for a in due}
        self.count.due[frame.index] = tuple(reasons)
        self.count.dropped.update({(frame.index, d): reason for d, reason in reasons.items() if reason})
        if all(reasons.values()):
            self.count.frames_dropped[next(iter(reasons.values()), None) or "not_assigned"] += 1

    def _send(self, frame: Frame, assignment: Assignment, now_s: float) -> str | None:
        """Why the frame could not be sent, or None."""
        if self._link.backlog_s(assignment.site, now_s) > self._max_backlog_s:
            return "link_full"
        packet = self._encode(frame, assignment)
        if self._link.send(assignment.site, assignment.detector, packet, now_s):
            self._packets_sent[assignment.detector] += 1
            return None
        # the decoder will miss this packet: the next one must stand alone
        self._encoders[assignment.detector] = self._encoder(assignment)
        return "receiver_busy"

    def _encoder(self, assignment: Assignment) -> Encoder:
        rate_hz = self.stream.processing_rate_hz / assignment.period
        return Encoder(
            assignment.codec or self.stream.codec,
            *self.stream.source.sent_size,
            frame_rate_hz=rate_hz,
            bitrate_bps=assignment.bitrate_bps / assignment.period,
            keyframe_interval=max(1, round(KEYFRAME_INTERVAL_S * rate_hz)),
        )

    def _encode(self, frame: Frame, assignment: Assignment) -> Packet:
        started = time.perf_counter()
        encoder = self._encoders[assignment.detector]
        encoded = encoder.encode_frame(frame.planes, frame.tick // assignment.period)
        encode_s = time.perf_counter() - started
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
            sequence=self._packets_sent[assignment.detector],
        )
