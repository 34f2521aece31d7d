"""The reducer actor: the one owner of the map."""

from __future__ import annotations

import threading
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from pipeline.allocation.plan import Plan
from pipeline.errors import SearchlightError, failure
from pipeline.link.receiver import Receiver
from pipeline.messages import Detections, Message
from pipeline.mission.local import make_reducer
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.stages.reducer import HopHistogram, ReducerStage

Address = tuple[str, int]


@dataclass(frozen=True)
class ReducerStatus:
    """What the reducer has done so far.

    results, dropped: per (stream, detector). frames, frames_dropped: per stream, each frame once.
    hops: latencies per (stream, detector) and hop.
    """

    open_substreams: int
    results: dict[tuple[str, str], int]
    detections: dict[tuple[str, str], int]
    dropped: dict[tuple[str, str], dict[str, int]]
    frames: dict[str, int]
    frames_dropped: dict[str, dict[str, int]]
    not_taken: dict[str, int]
    hops: dict[tuple[str, str], dict[str, HopHistogram]]
    rejected: int
    error: SearchlightError | None


class ReducerActor:
    """Takes results from every machine."""

    def __init__(
        self, prepared: PreparedMission, plan: Plan, host: str, token: bytes, realtime: bool
    ) -> None:
        _warm_up(prepared, plan)
        self._stage = make_reducer(prepared, plan, lateness=realtime)
        self._lock = threading.Lock()
        self._error: SearchlightError | None = None
        self._receiver = Receiver(host, self._receive, token=token)

    def address(self) -> Address:
        """Where the machines send their results."""
        return self._receiver.address

    def status(self) -> ReducerStatus:
        """A snapshot."""
        with self._lock:
            stage = self._stage
            streams = sorted({stream for stream, _ in stage.processed})
            return ReducerStatus(
                open_substreams=len(stage.open),
                results={key: len(frames) for key, frames in stage.processed.items()},
                detections=dict(stage.detections),
                dropped={key: dict(Counter(frames.values())) for key, frames in stage.dropped.items()},
                frames={stream: len(stage.frames(stream)) for stream in streams},
                frames_dropped={stream: stage.frames_dropped(stream) for stream in streams},
                not_taken=stage.not_taken,
                hops={key: dict(hops) for key, hops in stage.hops.items()},
                rejected=self._receiver.rejected,
                error=self._error,
            )

    def finish(self) -> ReducerStage:
        """Apply what is held back; the map and all that is known of how it came about."""
        self._receiver.close()
        with self._lock:
            self._stage.finish()
            return self._stage

    def _receive(self, message: Message) -> None:
        try:
            with self._lock:
                self._stage.push(message)
        except Exception as error:
            self._error = failure(error)
            raise


def _warm_up(prepared: PreparedMission, plan: Plan) -> None:
    """Compile what the first result would have to wait for, on a map that is thrown away."""
    stream = prepared.streams[0]
    pose = stream.trajectory.pose(stream.trajectory.span_s[0])
    assert pose is not None  # there is one at every sample
    detector = next(a.detector for a in plan.assignments if a.stream == stream.stream)
    box, score = np.array([[400.0, 200.0, 430.0, 260.0]]), np.array([0.9])
    scratch = make_reducer(replace(prepared, onto=None), plan, lateness=False)
    scratch.fuser.apply(
        Detections(stream.stream, detector, 0, 0, pose, box, score, np.zeros(1, dtype=np.int64))
    )
