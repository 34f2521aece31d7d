"""The model of a machine: it loads networks into its memory, decodes, looks, and keeps results until they are safe."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial

from pipeline.mission.controller.events import FailedSubstream, MachineReport
from pipeline.mission.controller.orders import Run
from pipeline.mission.controller.substreams import Opened, Substream
from pipeline.mission.rehearsal.packets import Result, ResultEnd, SentEnd, SentFrame
from pipeline.mission.rehearsal.process import Process
from pipeline.mission.rehearsal.timeline import Timeline

REPORT_S = 0.25
QUEUE = 32
RESEND_S = 0.5
EXECUTION_SHARE = 0.8


@dataclass
class _Held:
    """One substream: its place in the decoder, what waits, and the results that are not safe yet."""

    opened: Opened
    expected: int = 0
    decodes: bool = True
    waiting: deque[SentFrame | SentEnd] = field(default_factory=deque)
    busy: bool = False
    unsafe: dict[int, Result | ResultEnd] = field(default_factory=dict)


class ModelMachine(Process):
    """memory_of: bytes of a detector. most_bytes: the most that it ever held. too_early: packets for nobody ready."""

    def __init__(
        self,
        machine: str,
        timeline: Timeline,
        report: Callable[[MachineReport], None],
        send: Callable[[ModelMachine, Result | ResultEnd], None],
        *,
        memory_of: Callable[[str], float],
        rate_hz: float,
        load_s: Callable[[], float],
    ) -> None:
        super().__init__(f"machine:{machine}", timeline)
        self.machine = machine
        self.most_bytes = 0.0
        self.too_early = 0
        self._report, self._send, self._memory_of, self._rate_hz = report, send, memory_of, rate_hz
        self._load_s = load_s
        self._held: dict[Substream, _Held] = {}
        self._loaded: dict[tuple[str, str], bool] = {}
        self._failed: list[FailedSubstream] = []
        self._order = 0

    def start(self, incarnation: int) -> None:
        """A new process holds nothing."""
        super().start(incarnation)
        self._forget()
        self.every(REPORT_S, self.report)
        self.every(RESEND_S, self._resend)
        self.report()

    def run(self, order: Run) -> None:
        """Drop what is not wanted, then load what is."""
        if order.incarnation != self.incarnation or order.number < self._order:
            return
        self._order = order.number
        # what broke does not come back under its name: an order may have been given before that was known
        broken = {failed.substream for failed in self._failed}
        wanted = {o.key: o for o in order.substreams if o.key not in broken}
        self._held = {key: held for key, held in self._held.items() if key in wanted}
        instances = {key.instance for key in wanted}
        self._loaded = {i: ready for i, ready in self._loaded.items() if i in instances}
        for key, opened in wanted.items():
            self._held.setdefault(key, _Held(opened))
            if key.instance not in self._loaded:
                self._loaded[key.instance] = False
                self.after(self._load_s(), partial(self._is_loaded, key.instance))
        self.most_bytes = max(self.most_bytes, sum(self._memory_of(d) for _, d in self._loaded))
        self.report()

    def packet(self, message: SentFrame | SentEnd) -> None:
        """One message of a link."""
        held = self._held.get(message.substream)
        if held is None:
            return
        if not self._loaded.get(message.substream.instance, False):
            self.too_early += 1
        held.waiting.append(message)
        self._work(held)

    def safe(self, substream: Substream, sequences: Iterable[int]) -> None:
        """The reducer has these on its disk."""
        held = self._held.get(substream)
        if held is not None:
            for sequence in sequences:
                held.unsafe.pop(sequence, None)

    def break_detector(self, number: int) -> list[Substream]:
        """One of its detectors crashes; the substreams that it had."""
        keys = sorted(self._held)
        instance = keys[number % len(keys)].instance if keys else None
        broken = [key for key in keys if key.instance == instance]
        for key in broken:
            del self._held[key]
            self._failed.append(FailedSubstream(key, "crashed"))
        if instance is not None:
            self._loaded.pop(instance, None)
            self.report()
        return broken

    def report(self) -> None:
        """Say what it holds; failures are said again and again, and counted once by who hears of them."""
        ready = frozenset(key for key in self._held if self._loaded.get(key.instance, False))
        self._report(
            MachineReport(self.machine, self.incarnation, frozenset(self._held), ready, tuple(self._failed))
        )

    def _forget(self) -> None:
        self._held, self._loaded, self._failed = {}, {}, []
        self._order = 0

    def _is_loaded(self, instance: tuple[str, str]) -> None:
        if instance in self._loaded:
            self._loaded[instance] = True
            self.report()

    def _work(self, held: _Held) -> None:
        if held.busy or not held.waiting:
            return
        message = held.waiting.popleft()
        held.busy = True
        execution_s = EXECUTION_SHARE * held.opened.assignment.period / self._rate_hz
        self.after(execution_s, lambda: self._done(held, message))

    def _done(self, held: _Held, message: SentFrame | SentEnd) -> None:
        held.busy = False
        if self._held.get(message.substream) is held:
            self._pass_on(held, self._looked_at(held, message))
            self._work(held)

    def _looked_at(self, held: _Held, message: SentFrame | SentEnd) -> Result | ResultEnd:
        if isinstance(message, SentEnd):
            return ResultEnd(message.substream, message.sequence)
        if message.key:
            held.decodes = True
        elif message.sequence != held.expected:
            held.decodes = False
        held.expected = message.sequence + 1
        reason = None if held.decodes else "undecodable"
        if held.decodes and len(held.waiting) > QUEUE:
            reason = "machine_busy"
        return Result(message.substream, message.sequence, message.tick, reason)

    def _pass_on(self, held: _Held, result: Result | ResultEnd) -> None:
        held.unsafe[result.sequence] = result
        self._send(self, result)

    def _resend(self) -> None:
        for held in list(self._held.values()):
            for result in list(held.unsafe.values()):
                self._send(self, result)
