"""The machine actor: one process per machine; each of its substreams has a decoder, a detector, a thread."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.allocation.plan import Assignment
from pipeline.config.pool import PoolDetector
from pipeline.detection import PERSONS, Detector, NotFiniteError, open_pool_detector
from pipeline.errors import InputError, SearchlightError, failure
from pipeline.link.channel import LinkSender, Receiver
from pipeline.link.codec import Codec
from pipeline.messages import EndOfStream, Message, Packet
from pipeline.mission.stages.detector import DetectorStage
from pipeline.mission.stages.virtual_link import unlimited
from pipeline.sensor.substream import as_sent

Address = tuple[str, int]
#: packets that may wait for one detector; the sender's link feels what is above
QUEUE_PACKETS = 32
#: in real time a frame that waited longer is decoded (the next one needs it) but not looked at
MAX_WAIT_S = 1.0
_RESULTS = "reducer"


@dataclass(frozen=True)
class MachineStatus:
    """packets waiting per (stream, detector); connections refused; what went wrong, or None."""

    machine: str
    waiting: dict[tuple[str, str], int]
    rejected: int
    error: SearchlightError | None


class MachineActor:
    """One machine with its detectors."""

    def __init__(self, machine: str, host: str, token: bytes, codec: Codec) -> None:
        self._machine, self._host, self._token, self._codec = machine, host, token, codec
        self._queues: dict[tuple[str, str], queue.Queue[tuple[int, Message]]] = {}
        self._error: SearchlightError | None = None
        self._receiver: Receiver | None = None
        self._results = LinkSender(unlimited(), capacity_bytes=16 * 1024 * 1024)

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
            waiting: queue.Queue[tuple[int, Message]] = queue.Queue(QUEUE_PACKETS)
            self._queues[a.stream, a.detector] = waiting
            threading.Thread(target=self._work, args=(stage, waiting, realtime), daemon=True).start()
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
        waiting = {key: q.qsize() for key, q in self._queues.items()}
        return MachineStatus(
            self._machine, waiting, self._receiver.rejected if self._receiver else 0, self._error
        )

    def _receive(self, message: Message) -> None:
        if isinstance(message, Packet | EndOfStream):
            self._queues[message.stream, message.detector].put((time.time_ns(), message))

    def _work(self, stage: DetectorStage, waiting: queue.Queue[tuple[int, Message]], realtime: bool) -> None:
        try:
            while True:
                received_ns, message = waiting.get()
                late = realtime and time.time_ns() - received_ns > MAX_WAIT_S * 1e9
                result = stage.skip(message) if late else stage.process(message, received_ns)
                self._results.send(_RESULTS, result)
                if isinstance(message, EndOfStream):
                    return
        except Exception as error:
            self._error = failure(error)
