"""The machine actor: one process per machine; each of its substreams has a decoder, a detector, a thread."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from actors.nodes import Offer
from actors.site import own_host
from actors.usage import Usage
from pipeline.allocation.plan import Assignment
from pipeline.clock import Clock
from pipeline.config.pool import PoolDetector
from pipeline.detection import PERSONS, open_pool_detector
from pipeline.errors import InputError, RunFailedError, SearchlightError, failure, in_one_line
from pipeline.link.codec import Codec
from pipeline.link.keys import Endpoint, KeyPair
from pipeline.link.receiver import Receiver
from pipeline.link.sender import LinkSender, LinkState
from pipeline.logs import Log, log_of_actor
from pipeline.messages import EndOfStream, Message, Packet
from pipeline.mission.controller.events import MachineReport
from pipeline.mission.controller.orders import Run
from pipeline.mission.controller.substreams import Opened
from pipeline.mission.durable_reducer import Acknowledgement
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.stages.detector import Looks
from pipeline.mission.stages.detector_process import DetectorProcess
from pipeline.mission.stages.inbox import InboxParams
from pipeline.mission.stages.kept_results import KeptResults
from pipeline.mission.stages.machine import BLACK, MachineStage
from pipeline.mission.stages.virtual_link import unlimited
from pipeline.mission.who_may_say import refused_by_machine
from pipeline.sensor.substream import as_sent

_LOG = Log("actors")
_RESULTS = "reducer"


@dataclass(frozen=True)
class MachineParams:
    """result_bytes: of results that the reducer has not read. stalled_s: a reducer that reads nothing for so long has
    failed. resend_s: a result that was not acknowledged for so long is sent again. warm_s: after its begin, in real
    time, it makes ready for what it may have to take over. processes: each network runs in a process of its own.
    """

    inbox: InboxParams = field(default_factory=InboxParams)
    result_bytes: int = 16 * 1024 * 1024
    stalled_s: float = 60.0
    resend_s: float = 2.0
    warm_s: float = 3.0
    processes: bool = False

    def __post_init__(self) -> None:
        if self.result_bytes < 1 or not self.stalled_s > 0.0:
            raise ValueError(f"{self}; expected at least one byte, and a time above 0")


def machine_params(prepared: PreparedMission) -> MachineParams:
    """As the mission has them."""
    return MachineParams(processes=prepared.mission.processing.detectors_in == "processes")


@dataclass(frozen=True)
class MachineStatus:
    """packets waiting per (stream, detector); connections and messages that were not taken, by reason; what went wrong,
    or None; the way to the reducer.
    """

    machine: str
    waiting: dict[tuple[str, str], int]
    rejected: dict[str, int]
    refused: dict[str, int]
    error: SearchlightError | None
    results: LinkState
    pid: int = field(default_factory=os.getpid)
    usage: Usage = field(default_factory=Usage)


class MachineActor:
    """One machine with its detectors. Its key pair is made here, and stays here."""

    def __init__(
        self, machine: str, host: str | None, codec: Codec, params: MachineParams | None = None
    ) -> None:
        """host: to listen on; None: the node's own."""
        log_of_actor(f"machine-{machine}")
        self._machine, self._codec, self._keys = machine, codec, KeyPair()
        self._host = host or own_host()
        self._params, self._clock = params or MachineParams(), Clock()
        self._incarnation, self._sending = 0, threading.Lock()
        self._stuck: tuple[Message | None, float] = None, 0.0
        self._stage: MachineStage | None = None
        self._kept: KeptResults | None = None
        self._receiver: Receiver | None = None
        self._results = self._new_sender(reconnect=False)
        self._peers: dict[bytes, str] = {}
        self._models = Offer()

    def _new_sender(self, *, reconnect: bool) -> LinkSender:
        return LinkSender(
            unlimited(),
            capacity_bytes=self._params.result_bytes,
            keys=self._keys,
            name=f"machine {self._machine}",
            reconnect=reconnect,
            on_back=lambda _: self._send_all_again(),
        )

    def public_key(self) -> bytes:
        """By which everybody knows it."""
        return self._keys.public

    def accept_only(self, peers: Mapping[bytes, str]) -> None:
        """Whom to hear from now on: sources by public key; one that is not among them any more is cut off."""
        self._peers = dict(peers)
        if self._receiver is not None:
            self._receiver.accept_only(self._peers)

    def start(
        self,
        assignments: tuple[Assignment, ...],
        detectors: Mapping[str, PoolDetector],
        reducer: Endpoint,
        layers: Mapping[str, int] = PERSONS,
        models: Offer | None = None,
    ) -> Endpoint:
        """Load the pool's detectors and begin to listen (pace max); the endpoint for the substreams' packets.

        layers: ids of the map's layers by name. models: that are fetched where this node lacks them.
        """
        self._models = models or self._models
        self._results.connect(_RESULTS, reducer)
        self._stage = self._new_stage(detectors, layers, self._answer, drops=False)
        self._stage.run(Run(self._machine, tuple(Opened(0, a) for a in assignments)))
        self._stage.wait_ready()
        return self._listen(self._stage)

    def _new_stage(
        self,
        detectors: Mapping[str, PoolDetector],
        layers: Mapping[str, int],
        answer: Callable[[Message, bool], None],
        *,
        drops: bool,
    ) -> MachineStage:
        return MachineStage(
            self._machine,
            self._codec,
            lambda assignment: self._opened(assignment, detectors[assignment.pool_detector], layers),
            answer,
            self._ask_restart,
            self._params.inbox,
            self._clock,
            drops=drops,
        )

    def _opened(self, assignment: Assignment, detector: PoolDetector, layers: Mapping[str, int]) -> Looks:
        """Raises InputError, with the machine's name, for what cannot be had here, such as CUDA."""
        try:
            detector = self._models.on_this_node(detector)
            row = as_sent(detector, assignment.codec or self._codec, assignment.bitrate_bps)
            opened: Callable[..., Looks] = DetectorProcess if self._params.processes else open_pool_detector
            return opened(row, layers, assignment.setup)
        except InputError as error:
            where = f"machine {self._machine}: {error.where}"
            raise InputError(where, error.found, error.expected) from None

    def begin(
        self,
        detectors: Mapping[str, PoolDetector],
        reducer: Endpoint | None,
        layers: Mapping[str, int] = PERSONS,
        incarnation: int = 0,
        models: Offer | None = None,
    ) -> Endpoint:
        """Hold nothing yet, and listen (real time); the endpoint for packets. detectors: of the pool, by id. reducer:
        None while there is none. models: as in start.

        Results are kept until they are acknowledged: a reducer that is lost, or the way to it, is sent them again when
        it is back.
        """
        self._incarnation, self._models = incarnation, models or self._models
        self._kept = KeptResults()
        self._results.close()
        self._results = self._new_sender(reconnect=True)
        self._stage = self._new_stage(detectors, layers, self._keep_and_answer, drops=True)
        endpoint = self._listen(self._stage)
        if reducer is not None:
            self.results_to(reducer)
        warm = threading.Timer(self._params.warm_s, self._make_ready, (tuple(detectors.values()), layers))
        warm.daemon = True
        warm.start()
        return endpoint

    def _make_ready(self, detectors: Sequence[PoolDetector], layers: Mapping[str, int]) -> None:
        """For what may be taken over: have every model on this node while its radio is good, and look at one picture,
        since the first network of a process takes half a second longer than any other.
        """
        try:
            here = [self._models.on_this_node(d) for d in sorted(detectors, key=lambda d: d.memory)]
            for detector in here[:1]:
                open_pool_detector(detector, layers).detect(BLACK)
        except Exception as error:  # what is needed is tried again when it is
            _LOG.warning("machine not made ready", machine=self._machine, error=in_one_line(failure(error)))

    def _listen(self, stage: MachineStage) -> Endpoint:
        def refuse(peer: str, message: Message) -> str | None:
            if (reason := refused_by_machine(peer, message)) is not None:
                return reason
            assert isinstance(message, Packet | EndOfStream)
            return None if stage.holds(message) else "unknown_substream"

        self._receiver = Receiver(self._host, stage.put, keys=self._keys, peers=self._peers, refuse=refuse)
        return self._receiver.endpoint

    def run(self, order: Run) -> None:
        """Hold what the order says, and nothing else."""
        assert self._stage is not None, "begin comes first"
        assert self._kept is not None
        for key in self._stage.run(order):
            self._kept.forget(key.stream, key.detector, key.epoch)

    def results_to(self, reducer: Endpoint) -> None:
        """Send results there from now on, those first that are not known to be safe."""
        self._results.expect(_RESULTS, reducer)
        self._send_all_again()

    def report(self, safe: Sequence[Acknowledgement] = ()) -> tuple[MachineReport, MachineStatus]:
        """What it holds, and a snapshot. safe: what the reducer has on its disk."""
        assert self._stage is not None, "begin comes first"
        assert self._kept is not None
        self._kept.acknowledge(safe)
        self._send_what_is_stuck()
        return self._stage.report(self._incarnation), self.status()

    def _send_what_is_stuck(self) -> None:
        """Results that were not acknowledged for long are sent again; a reducer takes each once."""
        assert self._kept is not None
        oldest, now_s = self._kept.oldest, self._clock.monotonic_s()
        if oldest is not self._stuck[0]:
            self._stuck = oldest, now_s
        elif oldest is not None and now_s - self._stuck[1] > self._params.resend_s:
            self._stuck = oldest, now_s
            self._send_all_again()

    def _send_all_again(self) -> None:
        if self._kept is None:
            return
        with self._sending:
            for result in self._kept.again():
                self._try_to_send(result)

    def _keep_and_answer(self, result: Message, urgent: bool) -> None:
        assert self._kept is not None
        self._kept.keep(result)
        with self._sending:
            self._try_to_send(result)

    def _try_to_send(self, result: Message) -> None:
        """What cannot be sent now is sent to the next reducer."""
        with contextlib.suppress(ConnectionError):
            self._results.send(_RESULTS, result, 0.0)

    def status(self) -> MachineStatus:
        """A snapshot."""
        stage, receiver = self._stage, self._receiver
        waiting, error = (stage.waiting, stage.error) if stage else ({}, None)
        if receiver is not None and receiver.error is not None and error is None:
            error = failure(receiver.error)
        rejected, refused = (receiver.rejected, receiver.refused) if receiver else ({}, {})
        return MachineStatus(self._machine, waiting, rejected, refused, error, self._results.state())

    def _ask_restart(self, stream: str, detector: str) -> None:
        if self._receiver is not None:
            self._receiver.want_restart(stream, detector)

    def _answer(self, result: Message, urgent: bool) -> None:
        """urgent: never here, since at pace max no inbox drops."""
        limit_s = self._params.stalled_s
        try:
            if self._results.send(_RESULTS, result, limit_s):
                return
        except ConnectionError as error:
            raise RunFailedError(f"machine {self._machine}: {error}") from None
        raise RunFailedError(f"machine {self._machine}: the reducer took no result for {limit_s:g} s")
