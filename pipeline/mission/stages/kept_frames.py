"""Frames that no link could take, kept on the source's disk until one can.

A drone behind a ridge films on. What it cannot send is encoded and kept, in runs that begin with a picture that stands
alone, and is sent when the radio is back: between two runs of what is filmed then, while the link has room, and all of
it once the flight is over. A run is decoded by itself, so that it can go between any two others.
"""

from __future__ import annotations

import tempfile
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import BinaryIO, cast

from pipeline.allocation.plan import Assignment
from pipeline.link.codec import Encoder
from pipeline.messages import Frame, Packet, pack, unpack

#: of a run at most, seconds: so long what is filmed now waits for it
RUN_S = 0.5


@dataclass
class _Run:
    """Of consecutive frames for one detector. places: of its packets in the file, offset and length. reasons: why each
    could not be sent, by frame index. broken: no packet can be added any more.
    """

    assignment: Assignment
    encoder: Encoder
    places: list[tuple[int, int]]
    reasons: dict[int, str]
    last_tick: int
    broken: bool = False


class KeptFrames:
    """Of one stream. limit_bytes: on the disk; when it is full nothing more is kept until all of it is sent.

    encode(frame, assignment, encoder): the packet of a frame; its epoch and sequence are filled in when it is sent.
    rate_hz: of the stream's processing clock.
    """

    def __init__(
        self,
        limit_bytes: int,
        rate_hz: float,
        new_encoder: Callable[[Assignment, int], Encoder],
        encode: Callable[[Frame, Assignment, Encoder], Packet],
    ) -> None:
        self._limit_bytes, self._rate_hz = limit_bytes, rate_hz
        self._new_encoder, self._encode = new_encoder, encode
        self._file: BinaryIO | None = None
        self._used_bytes = 0
        self._runs: dict[str, deque[_Run]] = {}

    def __len__(self) -> int:
        return sum(len(run.places) for runs in self._runs.values() for run in runs)

    def keep(self, frame: Frame, assignment: Assignment, reason: str) -> bool:
        """Keep a frame for a detector; False if there is no room, or the disk does not take it."""
        if self._used_bytes >= self._limit_bytes:
            return False
        runs = self._runs.setdefault(assignment.detector, deque())
        most = max(1, round(RUN_S * self._rate_hz / assignment.period))
        run = runs[-1] if runs else None
        if run is None or not _continues(run, frame, assignment, most):
            run = _Run(assignment, self._new_encoder(assignment, most), [], {}, frame.tick)
        data = pack(self._encode(frame, assignment, run.encoder))
        try:
            place = self._write(data)
        except OSError:
            run.broken = True  # what comes next would need this one
            return False
        if not run.places:
            runs.append(run)
        run.places.append(place)
        run.reasons[frame.index] = reason
        run.last_tick = frame.tick
        return True

    def take(self, assignment: Assignment) -> list[Packet]:
        """The oldest run that this detector can take, to be sent now; none if there is none.

        It has to be of the same bitrate: what a look is worth goes by that.
        """
        runs = self._runs.get(assignment.detector)
        if not runs or not _fits(runs[0].assignment, assignment):
            return []
        run = runs.popleft()
        packets = [self._read(*place) for place in run.places]
        self._let_go_if_empty()
        return packets

    def give_up(self) -> dict[tuple[int, str], str]:
        """Keep nothing any more; why each frame had not been sent, by frame index and detector."""
        reasons = {
            (index, detector): reason
            for detector, runs in self._runs.items()
            for run in runs
            for index, reason in run.reasons.items()
        }
        self._runs.clear()
        self._let_go_if_empty()
        return reasons

    def _write(self, data: bytes) -> tuple[int, int]:
        if self._file is None:
            # it has no name: whatever ends this process, nothing stays
            self._file = cast(BinaryIO, tempfile.TemporaryFile(prefix="searchlight-kept-"))  # noqa: SIM115
        offset = self._used_bytes
        self._file.seek(offset)
        self._file.write(data)
        self._file.flush()
        self._used_bytes += len(data)
        return offset, len(data)

    def _read(self, offset: int, length: int) -> Packet:
        assert self._file is not None
        self._file.seek(offset)
        packet = unpack(self._file.read(length))
        assert isinstance(packet, Packet)
        return packet

    def _let_go_if_empty(self) -> None:
        if not len(self) and self._file is not None:
            self._file.close()
            self._file, self._used_bytes = None, 0


def _continues(run: _Run, frame: Frame, assignment: Assignment, most: int) -> bool:
    is_next = frame.tick - run.last_tick == assignment.period
    return is_next and not run.broken and len(run.places) < most and _fits(run.assignment, assignment)


def _fits(kept: Assignment, assignment: Assignment) -> bool:
    def of(a: Assignment) -> tuple[object, ...]:
        return a.detector, a.period, a.bitrate_bps, a.codec

    return of(kept) == of(assignment)
