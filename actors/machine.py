"""The machine actor: one process per machine; each of its substreams has a decoder, a detector, a thread."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pipeline.allocation.plan import Assignment
from pipeline.clock import Clock
from pipeline.config.pool import PoolDetector
from pipeline.detection import PERSONS, Detector, NotFiniteError, open_pool_detector
from pipeline.errors import InputError, RunFailedError, SearchlightError, failure
from pipeline.link.codec import Codec
from pipeline.link.receiver import Receiver
from pipeline.link.sender import LinkSender, LinkState
from pipeline.messages import Dropped, EndOfStream, Message, Packet
from pipeline.mission.stages.detector import DetectorStage
from pipeline.mission.stages.inbox import Inbox, InboxParams
from pipeline.mission.stages.virtual_link import unlimited
from pipeline.sensor.substream import as_sent

Address = tuple[str, int]
_RESULTS = "reducer"


@dataclass(frozen=True)
class MachineParams:
    """result_bytes: of results that the reducer has not read. stalled_s: a reducer that reads nothing for so long has
    failed.
    """

    inbox: InboxParams = field(default_factory=InboxParams)
    result_bytes: int = 16 * 1024 * 1024
    stalled_s: float = 60.0

    def __post_init__(self) -> None:
        if self.result_bytes < 1 or not self.stalled_s > 0.0:
            raise ValueError(f"{self}; expected at least one byte, and a time above 0")


@dataclass(frozen=True)
class MachineStatus:
    """packets waiting per (stream, detector); connections refused; what went wrong, or None; the way to the reducer."""

    machine: str
    waiting: dict[tuple[str, str], int]
    rejected: int
    error: SearchlightError | None
    results: LinkState


class MachineActor:
    """One machine with its detectors."""

    def __init__(
        self, machine: str, host: str, token: bytes, codec: Codec, params: MachineParams | None = None
    ) -> None:
        self._machine, self._host, self._token, self._codec = machine, host, token, codec
        self._params, self._clock = params or MachineParams(), Clock()
        self._inboxes: dict[tuple[str, str], Inbox] = {}
        self._error: SearchlightError | None = None
        self._receiver: Receiver | None = None
        self._results = LinkSender(
            unlimited(), capacity_bytes=self._params.result_bytes, name=f"machine {machine}"
        )

    def start(
        self,
        assignments: tuple[Assignment, ...],
        detectors: Mapping[str, PoolDetector],
        reducer: Address,
        realtime: bool,
        layers: Mapping[str, int] = PERSONS,
    ) -> Address:
        """Load the pool's detectors, begin to listen; the address for the substreams' packets.

        layers: ids of the map's layers by name.
        """
        self._layers = layers
        self._results.connect(_RESULTS, reducer, self._token)
        for a in assignments:
            detector = self._opened(a, detectors[a.pool_detector])
            # the first picture takes longer than all others: not while the drone flies
            with contextlib.suppress(NotFiniteError):  # of a black picture; frames are dropped and counted
                detector.detect(np.zeros((576, 1024, 3), dtype=np.uint8))
            stage = DetectorStage(detector, a.codec or self._codec)
            inbox = self._inboxes[a.stream, a.detector] = self._inbox(a, drops=realtime)
            threading.Thread(target=self._work, args=(stage, inbox), daemon=True).start()
        self._receiver = Receiver(self._host, self._receive, token=self._token)
        return self._receiver.address

    def _opened(self, assignment: Assignment, detector: PoolDetector) -> Detector:
        """Raises InputError, with the machine's name, for what cannot be had here, such as CUDA."""
        try:
            row = as_sent(detector, assignment.codec or self._codec, assignment.bitrate_bps)
            return open_pool_detector(row, self._layers, assignment.setup)
        except InputError as error:
            where = f"machine {self._machine}: {error.where}"
            raise InputError(where, error.found, error.expected) from None

    def status(self) -> MachineStatus:
        """A snapshot."""
        waiting = {key: len(inbox) for key, inbox in self._inboxes.items()}
        receiver, error = self._receiver, self._error
        if receiver is not None and receiver.error is not None and error is None:
            error = failure(receiver.error)
        rejected = receiver.rejected if receiver else 0
        return MachineStatus(self._machine, waiting, rejected, error, self._results.state())

    def _inbox(self, assignment: Assignment, drops: bool) -> Inbox:
        stream, detector = assignment.stream, assignment.detector

        def want_restart() -> None:
            if self._receiver is not None:
                self._receiver.want_restart(stream, detector)

        def on_drop(drop: Dropped) -> None:  # on the thread that reads, which waits for nobody
            self._answer(drop, patience_s=0.0)

        return Inbox(self._params.inbox, self._clock, drops=drops, on_drop=on_drop, want_restart=want_restart)

    def _receive(self, message: Message) -> None:
        if isinstance(message, Packet | EndOfStream):
            self._inboxes[message.stream, message.detector].put(message)

    def _work(self, stage: DetectorStage, inbox: Inbox) -> None:
        try:
            while True:
                waiting = inbox.get()
                message = waiting.message
                late = inbox.is_late(waiting)
                self._answer(stage.skip(message) if late else stage.process(message, waiting.received_ns))
                if isinstance(message, EndOfStream):
                    return
        except Exception as error:
            self._error = failure(error)

    def _answer(self, result: Message, patience_s: float | None = None) -> None:
        limit_s = self._params.stalled_s if patience_s is None else patience_s
        try:
            if self._results.send(_RESULTS, result, limit_s):
                return
        except ConnectionError as error:
            raise RunFailedError(f"machine {self._machine}: {error}") from None
        raise RunFailedError(f"machine {self._machine}: the reducer took no result for {limit_s:g} s")
