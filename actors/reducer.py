"""The reducer actor: the one owner of the map."""

from __future__ import annotations

import math
import os
import threading
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

from actors.site import own_host
from actors.usage import Usage
from pipeline.allocation.plan import Plan, assignment_from_json, assignment_to_json
from pipeline.clock import Clock
from pipeline.errors import SearchlightError, failure, in_one_line
from pipeline.ingest.finding import Finding
from pipeline.link.keys import Endpoint, KeyPair
from pipeline.link.receiver import Receiver
from pipeline.logs import Log, log_of_actor
from pipeline.messages import Detections, Dropped, Message
from pipeline.mission.capture_bound import CaptureBound
from pipeline.mission.controller.events import ReducerReport
from pipeline.mission.controller.orders import Expect
from pipeline.mission.controller.substreams import Substream
from pipeline.mission.durable_reducer import Acknowledgement
from pipeline.mission.live_files import LiveMap, MapFigures
from pipeline.mission.local import make_reducer
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.run_journal import RunJournal, journal_findings
from pipeline.mission.stages.latency import HopHistogram
from pipeline.mission.stages.reducer import ReducerStage
from pipeline.mission.warm_up import warm_up
from pipeline.mission.who_may_say import refused_by_reducer
from pipeline.outputs.live_names import LIVE

_LOG = Log("actors")
#: how often the live view is looked at, and how long it rests after a fault, seconds
_LOOK_S, _AFTER_FAULT_S = 0.1, 10.0
#: an answer waits so long for the map, which may be busy with a slow disk, and is then the last one; for so long
_PATIENCE_S, _STUCK_S = 0.2, 15.0
#: an order is carried out at latest so much later
_ORDERS_S = 0.05


@dataclass(frozen=True)
class ReducerStatus:
    """What the reducer has done so far.

    results, dropped: per (stream, detector). frames, frames_dropped: per stream, each frame once.
    hops: latencies per (stream, detector) and hop. acknowledged: what is on the disk. trouble: why nothing is written
    there at present. taken: messages that came, per (stream, detector). rejected, refused: connections and
    messages that were not taken, by reason. map: what the last snapshot of the live view found. ages_s: in real time,
    by stream, of the newest frame that the map knows.
    """

    open_substreams: int
    results: dict[tuple[str, str], int]
    detections: dict[tuple[str, str], int]
    dropped: dict[tuple[str, str], dict[str, int]]
    frames: dict[str, int]
    frames_dropped: dict[str, dict[str, int]]
    not_taken: dict[str, int]
    hops: dict[tuple[str, str], dict[str, HopHistogram]]
    rejected: dict[str, int]
    refused: dict[str, int]
    error: SearchlightError | None
    acknowledged: tuple[Acknowledgement, ...] = ()
    trouble: str | None = None
    taken: dict[tuple[str, str], int] = field(default_factory=dict)
    pid: int = field(default_factory=os.getpid)
    usage: Usage = field(default_factory=Usage)
    map: MapFigures | None = None
    ages_s: dict[str, float] = field(default_factory=dict)


class ReducerActor:
    """Takes results from every machine. A thread of its own commits what was taken, and writes checkpoints; another one
    shows the map while it grows, see ``live_files``. Its key pair is made here, and stays here.
    """

    def __init__(
        self,
        prepared: PreparedMission,
        plan: Plan,
        host: str | None,
        realtime: bool,
        journal: RunJournal,
    ) -> None:
        """host: to listen on; None: the node's own. journal: on a disk of the node that the actor is on; what it
        holds is where the reducer begins.
        """
        log_of_actor("reducer")
        warm_up(prepared, plan)
        self._stage = make_reducer(prepared, plan, lateness=realtime)
        self._durable = journal.reducer(self._stage, time.monotonic())
        self._stage.utc_ns = (
            Clock().utc_ns if realtime else None
        )  # not before: what the journal holds came long ago
        self._changed = threading.Condition()
        self._orders: deque[Expect] = deque()
        self._said: tuple[frozenset[Substream], frozenset[Substream], ReducerStatus] | None = None
        self._said_s = -math.inf
        self._error: SearchlightError | None = None
        self._finished = False
        self._live = LiveMap(journal.folder.parent / LIVE, prepared)
        threading.Thread(target=self._keep, name="journal", daemon=True).start()
        threading.Thread(target=self._show, name="live", daemon=True).start()
        opened = map(assignment_from_json, self._stage.opened.values())
        self._bound = CaptureBound(prepared.streams, max(1.0, prepared.mission.fusion.lateness))
        self._machine_of = {a.detector: a.machine for a in (*plan.assignments, *opened)}
        self._receiver = Receiver(host or own_host(), self._receive, keys=KeyPair(), refuse=self._refuse)

    def endpoint(self) -> Endpoint:
        """Where the machines send their results."""
        return self._receiver.endpoint

    def clock_runs(self, now_ns: Mapping[str, int]) -> None:
        """The streams film. now_ns: the capture time that each has now; what is newer than now is refused."""
        self._bound.runs(now_ns)

    def accept_only(self, peers: Mapping[bytes, str]) -> None:
        """Whom to hear from now on: machines by public key; one that is not among them any more is cut off."""
        self._receiver.accept_only(peers)

    def acknowledged(self) -> tuple[Acknowledgement, ...]:
        """What is on the disk, and need not be sent."""
        with self._changed:
            return self._durable.acknowledged

    def expect(self, order: Expect) -> None:
        """Hold open what the order says, with what it is worth, and close all else; both are on the disk when they are
        reported. It returns at once: the next question must not wait for a slow disk.
        """
        self._orders.append(order)

    def _carry_out(self, order: Expect) -> None:
        self._machine_of |= {o.key.detector: o.assignment.machine for o in order.open}
        reasons = {close.substream: close.reason for close in order.close}
        for opened in order.open:
            key = opened.key.stream, opened.key.detector, opened.key.epoch
            if key not in self._stage.open and key not in self._stage.sequencer.over:
                self._durable.open_again(*key, assignment_to_json(opened.assignment))
        wanted = {(k.stream, k.detector, k.epoch) for k in order.keys}
        # what is to be closed may never have been opened here: it is not to be opened later either
        named = {(k.stream, k.detector, k.epoch) for k in reasons} - self._stage.sequencer.over
        for key in sorted((self._stage.open - wanted) | named):
            self._durable.close(*key, reasons.get(Substream(*key), "not_used"))
        self._durable.commit()

    def report(self, incarnation: int = 0) -> tuple[ReducerReport, ReducerStatus]:
        """What is open and closed, and a snapshot; while the map is busy what was said before, for a while."""
        is_recent = time.monotonic() - self._said_s < _STUCK_S
        if self._changed.acquire(timeout=_PATIENCE_S if is_recent else -1.0):
            try:
                open_ = frozenset(Substream(*key) for key in self._stage.open)
                closed = frozenset(Substream(*key) for key in self._stage.sequencer.over)
                self._said, self._said_s = (open_, closed, self.status()), time.monotonic()
            finally:
                self._changed.release()
        assert self._said is not None
        open_, closed, status = self._said
        return ReducerReport(incarnation, open_, closed), status

    def status(self) -> ReducerStatus:
        """A snapshot."""
        with self._changed:
            stage = self._stage
            streams = sorted({stream for stream, _ in stage.processed})
            return ReducerStatus(
                open_substreams=len(stage.open),
                results={key: len(frames) for key, frames in stage.processed.items()},
                detections=dict(stage.detections),
                dropped={key: dict(+reasons) for key, reasons in stage.drops.items()},
                frames={stream: len(stage.frames(stream)) for stream in streams},
                frames_dropped={stream: stage.frames_dropped(stream) for stream in streams},
                not_taken=stage.not_taken,
                hops={key: dict(hops) for key, hops in stage.hops.items()},
                rejected=self._receiver.rejected,
                refused=self._receiver.refused,
                error=self._error,
                acknowledged=self._durable.acknowledged,
                trouble=self._durable.trouble,
                taken=self._durable.taken,
                map=self._live.figures,
                ages_s=self._bound.ages_s(stage.fuser.last_ns),
            )

    def finish(self) -> tuple[ReducerStage, tuple[Finding, ...]]:
        """Apply what is held back; the map and all that is known of how it came about, and of its journal."""
        self._receiver.close()
        with self._changed:
            self._finished = True
            self._changed.notify_all()
            self._durable.finish()
            return self._stage, journal_findings(self._durable)

    def _refuse(self, peer: str, message: Message) -> str | None:
        if (message.stream, message.detector) not in self._stage.received:
            return "unknown_substream"
        if isinstance(message, Detections | Dropped) and self._bound.is_beyond(
            message.stream, message.time_ns
        ):
            return "from_the_future"
        return refused_by_reducer(peer, message, self._machine_of)

    def _receive(self, message: Message) -> None:
        try:
            with self._changed:
                before = self._durable.due_s
                self._durable.push(message, time.monotonic())
                if self._durable.due_s < before:
                    self._changed.notify_all()
        except Exception as error:
            self._error = failure(error)
            _LOG.warning("a result could not be taken", error=str(self._error))
            raise

    def _keep(self) -> None:
        """Carry out orders, commit, and write checkpoints when they are due."""
        try:
            with self._changed:
                while not self._finished:
                    due_s = self._durable.due_s - time.monotonic()
                    self._changed.wait(min(max(0.0, due_s), _ORDERS_S))
                    while self._orders and not self._finished:
                        self._carry_out(self._orders.popleft())
                    if not self._finished:
                        self._durable.tick(time.monotonic())
        except Exception as error:
            self._error = failure(error)

    def _show(self) -> None:
        """Write the live view's snapshots; a fault of theirs must not cost the map."""
        while not self._finished:
            time.sleep(_LOOK_S)
            try:
                self._live.write_if_due(self._stage, time.monotonic(), self._changed)
            except Exception as error:
                _LOG.warning("live view not written", error=in_one_line(failure(error)))
                self._live.due_s = time.monotonic() + _AFTER_FAULT_S
