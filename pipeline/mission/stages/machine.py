"""The machine stage: the substreams that a machine holds, as it is ordered.

Each substream has a decoder, an inbox and a thread. The network of a stream is loaded once, whatever the epoch of its
substreams; it looks at one picture at a time. What fails takes its own substreams with it, and no others.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.allocation.plan import Assignment
from pipeline.clock import Clock
from pipeline.detection import NotFiniteError
from pipeline.errors import SearchlightError, failure
from pipeline.link.codec import Codec
from pipeline.logs import Log
from pipeline.messages import Detections, Dropped, EndOfStream, FloatArray, Message, Packet
from pipeline.mission.controller.events import FailedSubstream, MachineReport
from pipeline.mission.controller.orders import Run
from pipeline.mission.controller.substreams import Opened, Substream
from pipeline.mission.stages.detector import DetectorStage, Looks
from pipeline.mission.stages.inbox import Inbox, InboxParams

_LOG = Log("mission")
#: of the first picture, which takes longer than all others
BLACK = np.zeros((576, 1024, 3), dtype=np.uint8)


class _Network:
    """A loaded network that several substreams may use, one after the other."""

    def __init__(self, assignment: Assignment, detector: Looks) -> None:
        self.assignment = assignment
        self._detector, self._lock = detector, threading.Lock()

    def detect(self, image: NDArray[np.uint8]) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
        """See Looks."""
        with self._lock:
            return self._detector.detect(image)


@dataclass(eq=False)
class _Held:
    opened: Opened
    inbox: Inbox
    ready: threading.Event = field(default_factory=threading.Event)


class MachineStage:
    """machine: its name. load: opens the network of an assignment. answer: takes the results, on the threads of the
    substreams; a Dropped of a full inbox comes on the thread of the receiver, urgent.

    drops: see Inbox. want_restart(stream, detector): ask for a packet that stands alone.
    """

    def __init__(
        self,
        machine: str,
        codec: Codec,
        load: Callable[[Assignment], Looks],
        answer: Callable[[Message, bool], None],
        want_restart: Callable[[str, str], None],
        params: InboxParams,
        clock: Clock,
        *,
        drops: bool,
    ) -> None:
        self._machine, self._codec, self._load, self._send = machine, codec, load, answer
        self._want_restart, self._params, self._clock, self._drops = want_restart, params, clock, drops
        self._held: dict[Substream, _Held] = {}
        self._networks: dict[tuple[str, str], _Network] = {}
        self._failed: dict[Substream, SearchlightError] = {}
        self._order = -1
        self._lock, self._loading = threading.Lock(), threading.Lock()

    def run(self, order: Run) -> tuple[Substream, ...]:
        """Drop what is not in the order, and begin to load what is new; the substreams that were dropped.

        An order that comes after one with a higher number changes nothing. A substream that has failed does not come
        back: the order may be from before that was known.
        """
        with self._lock:
            if order.number < self._order:
                return ()
            self._order = order.number
            wanted = {o.key: o for o in order.substreams if o.key not in self._failed}
            dropped = tuple(key for key in self._held if key not in wanted)
            for key in dropped:
                self._held.pop(key).inbox.close()
            used = {key.instance for key in wanted}
            self._networks = {key: n for key, n in self._networks.items() if key in used}
            new = [o for key, o in wanted.items() if key not in self._held]
            for opened in new:
                self._held[opened.key] = _Held(opened, self._inbox(opened.assignment))
            held = [self._held[o.key] for o in new]
        for one in held:
            threading.Thread(
                target=self._work, args=(one,), name=f"detect {one.opened.key}", daemon=True
            ).start()
        return dropped

    def holds(self, message: Packet | EndOfStream) -> bool:
        """Whether the message is of a substream that is held."""
        return Substream(message.stream, message.detector, message.epoch) in self._held

    def put(self, message: Message) -> None:
        """A message of a source; of a substream that is not held it is nobody's."""
        if isinstance(message, Packet | EndOfStream):
            held = self._held.get(Substream(message.stream, message.detector, message.epoch))
            if held is not None:
                held.inbox.put(message)

    def report(self, incarnation: int = 0) -> MachineReport:
        """What it holds, for the controller."""
        with self._lock:
            ready = frozenset(key for key, held in self._held.items() if held.ready.is_set())
            failed = tuple(FailedSubstream(key, str(error)) for key, error in sorted(self._failed.items()))
            return MachineReport(self._machine, incarnation, frozenset(self._held), ready, failed)

    @property
    def waiting(self) -> dict[tuple[str, str], int]:
        """Packets that wait, by stream and detector."""
        with self._lock:
            return {key.instance: len(held.inbox) for key, held in self._held.items()}

    @property
    def error(self) -> SearchlightError | None:
        """Why a substream failed, if one did."""
        with self._lock:
            return next(iter(self._failed.values()), None)

    def wait_ready(self) -> None:
        """Wait until every substream is ready. Raises the error of one that failed."""
        with self._lock:
            held = list(self._held.values())
        for one in held:
            one.ready.wait()
        if (error := self.error) is not None:
            raise error

    def _inbox(self, assignment: Assignment) -> Inbox:
        stream, detector = assignment.stream, assignment.detector

        def on_drop(drop: Dropped) -> None:  # on the thread that reads, which waits for nobody
            self._send(drop, True)

        return Inbox(
            self._params,
            self._clock,
            drops=self._drops,
            on_drop=on_drop,
            want_restart=lambda: self._want_restart(stream, detector),
        )

    def _work(self, held: _Held) -> None:
        key = held.opened.key
        try:
            stage = DetectorStage(self._network(held.opened.assignment), self._of(held.opened.assignment))
            held.ready.set()
            while (waiting := held.inbox.get()) is not None:
                message = waiting.message
                if held.inbox.is_late(waiting):
                    self._send(stage.skip(message), False)
                else:
                    waited_s = self._clock.monotonic_s() - waiting.received_s
                    result = stage.process(message, waiting.received_ns, waited_s)
                    self._send(self._stamped(result), False)
                if isinstance(message, EndOfStream):
                    return
        except Exception as error:
            self._fail(key, failure(error))
        finally:
            held.ready.set()  # whoever waits for it need not wait any longer

    def _stamped(self, result: Message) -> Message:
        """In real time a result says when it was made."""
        if not isinstance(result, Detections) or not self._drops:
            return result
        return replace(result, hops=replace(result.hops, answered_ns=self._clock.utc_ns()))

    def _of(self, assignment: Assignment) -> Codec:
        return assignment.codec or self._codec

    def _network(self, assignment: Assignment) -> _Network:
        """The network of a stream, loaded now if it is not there, or not as this assignment wants it."""
        instance = assignment.stream, assignment.detector
        with self._loading:
            network = self._networks.get(instance)
            if network is not None and _same_network(network.assignment, assignment):
                return network
            network = _Network(assignment, self._load(assignment))
            with contextlib.suppress(NotFiniteError):  # of a black picture; frames are dropped and counted
                network.detect(BLACK)
            self._networks[instance] = network
            return network

    def _fail(self, key: Substream, error: SearchlightError) -> None:
        _LOG.warning("detector failed", machine=self._machine, substream=str(key), error=str(error))
        with self._lock:
            self._failed[key] = error
            if (held := self._held.pop(key, None)) is not None:
                held.inbox.close()
            if key.instance not in {k.instance for k in self._held}:
                self._networks.pop(key.instance, None)


def _same_network(a: Assignment, b: Assignment) -> bool:
    """Calibration is by bitrate and codec: another one is another detector, though the file is the same."""
    return (a.pool_detector, a.bitrate_bps, a.codec, a.setup) == (
        b.pool_detector,
        b.bitrate_bps,
        b.codec,
        b.setup,
    )
