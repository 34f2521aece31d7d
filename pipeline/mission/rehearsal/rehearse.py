"""One mission in virtual time."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from pipeline.allocation.problem import Problem
from pipeline.mission.controller.controller import step
from pipeline.mission.controller.events import Event, Gone, MachineReport, NotSolved, Solved, SourceReport
from pipeline.mission.controller.orders import Expect, Finish, Order, Restart, Run, Say, Send, Solve
from pipeline.mission.controller.params import ControllerParams
from pipeline.mission.controller.state import REDUCER, MissionState, machine_actor, source_actor
from pipeline.mission.controller.substreams import Substream
from pipeline.mission.rehearsal.chaos import Fault
from pipeline.mission.rehearsal.link import ModelLink
from pipeline.mission.rehearsal.machine import ModelMachine
from pipeline.mission.rehearsal.packets import Result, ResultEnd, SentEnd, SentFrame
from pipeline.mission.rehearsal.process import Process
from pipeline.mission.rehearsal.reducer import ModelReducer
from pipeline.mission.rehearsal.scheduler import Controller, ModelScheduler
from pipeline.mission.rehearsal.source import ModelSource
from pipeline.mission.rehearsal.timeline import Timeline


@dataclass(frozen=True)
class NetworkParams:
    """Of messages of control, and of results: delay from delay_s[0] to delay_s[1], loss: share that never comes.

    boot_s: from the order to start a process to its first word. gone_s: until the end of a process is noticed.
    load_s: of a network into the memory of a machine. solve_s: what the solver takes; unanswered: how often it dies.
    """

    delay_s: tuple[float, float] = (0.001, 0.05)
    loss: float = 0.02
    boot_s: tuple[float, float] = (0.3, 1.5)
    gone_s: tuple[float, float] = (0.05, 0.4)
    load_s: tuple[float, float] = (0.2, 2.0)
    solve_s: tuple[float, float] = (0.05, 1.0)
    unanswered: float = 0.05
    own_site_bps: float = 1e9


@dataclass
class Noted:
    """acknowledged: by substream, what the reducer said is safe. said: every line, with its time.

    struck: faults of actors that the controller counted on at that moment. crashed: substreams whose detector broke,
    and when.
    states: of the controller, by time.
    """

    acknowledged: dict[Substream, set[int]] = field(default_factory=dict)
    said: list[tuple[float, Say]] = field(default_factory=list)
    restarts: list[tuple[float, str]] = field(default_factory=list)
    struck: list[Fault] = field(default_factory=list)
    crashed: list[tuple[float, Substream]] = field(default_factory=list)
    states: dict[float, MissionState] = field(default_factory=dict)


class Rehearsal:
    """The models of all actors and what goes between them.

    ticks: frames of each stream. faults: what goes wrong, and when.
    """

    def __init__(
        self,
        problem: Problem,
        solver: Callable[[Solve], Sequence[Solved | NotSolved]],
        *,
        ticks: int,
        faults: tuple[Fault, ...] = (),
        seed: int = 0,
        network: NetworkParams | None = None,
        params: ControllerParams | None = None,
        here: Collection[str] | None = None,
        controller: Controller = step,
    ) -> None:
        """here: sites on the scheduler's own host; None: all. controller: what takes its events."""
        self.problem, self.ticks, self.faults = problem, ticks, faults
        self.timeline, self.noted = Timeline(), Noted()
        self._rng, self._network = np.random.default_rng(seed), network or NetworkParams()
        self._impossible_until: dict[str, float] = {}
        self.scheduler = ModelScheduler(
            problem,
            self.timeline,
            solver,
            self._carry_out,
            params or ControllerParams(),
            self._solve_s,
            here,
            controller,
        )
        self._parted: Counter[str] = Counter()
        self.reducer = ModelReducer(self.timeline, self._report, self._acknowledge)
        memory = {d.id: d.memory_bytes for d in problem.detectors}
        self.machines = {
            m.id: ModelMachine(
                m.id,
                self.timeline,
                self._report,
                self._result,
                memory_of=memory.__getitem__,
                rate_hz=problem.frame_rate_hz,
                load_s=lambda: self._delay_s(self._network.load_s),
            )
            for m in problem.machines
        }
        self.sources = {v: self._source(v) for v in problem.streams}

    def run(self, until_s: float, note_s: tuple[float, ...] = ()) -> None:
        """Play it to its end, or to a time. note_s: when the controller's state is noted."""
        for at_s in note_s:
            self.timeline.at(at_s, partial(self._note, at_s))
        for process in self._processes().values():
            process.start(0)
        for fault in self.faults:
            self.timeline.at(fault.at_s, partial(self._strike, fault))
        self.timeline.run(until_s, lambda: self.is_over)

    def _note(self, at_s: float) -> None:
        self.noted.states[at_s] = self.scheduler.state

    @property
    def is_over(self) -> bool:
        """Whether the map is out, and the controller knows."""
        return self.reducer.finished and self.scheduler.state.finished

    def _processes(self) -> dict[str, Process]:
        all_ = (*self.machines.values(), *self.sources.values(), self.reducer, self.scheduler)
        return {process.name: process for process in all_}

    def _source(self, stream: str) -> ModelSource:
        links = {}
        for site in self.problem.sites:
            bps = self.problem.link(stream, site)
            if bps > 0.0:
                rate_bps = self._network.own_site_bps if math.isinf(bps) else bps
                links[site] = ModelLink(self.timeline, rate_bps, self._packet)
        return ModelSource(
            stream,
            self.timeline,
            links,
            self._report,
            rate_hz=self.problem.frame_rate_hz,
            ticks=self.ticks,
        )

    # --- what goes between the actors

    def _carried(self, act: Callable[[], None], actor: str) -> None:
        """Bring a message of control, or a result, from or to an actor to where it goes, or lose it."""
        if self._rng.random() >= self._network.loss and not self._parted[self._site_of(actor)]:
            self.timeline.after(self._delay_s(self._network.delay_s), act)

    def _site_of(self, actor: str) -> str:
        """Where it is; the reducer and the scheduler are where no radio parts them."""
        kind, _, name = actor.partition(":")
        if kind == "machine":
            return next((m.site for m in self.problem.machines if m.id == name), "")
        return self._home_of(name) if kind == "source" else ""

    def _home_of(self, stream: str) -> str:
        return next((s for s in self.problem.sites if math.isinf(self.problem.link(stream, s))), "")

    def _delay_s(self, between: tuple[float, float]) -> float:
        return float(self._rng.uniform(*between))

    def _solve_s(self) -> float:
        dies = self._rng.random() < self._network.unanswered
        return math.inf if dies else self._delay_s(self._network.solve_s)

    def _report(self, event: Event) -> None:
        self._carried(lambda: self.scheduler.receive(lambda: self.scheduler.hear(event)), _speaker(event))

    def _packet(self, message: SentFrame | SentEnd) -> None:
        machine = self.machines[message.substream.detector.partition(":")[0]]
        machine.receive(lambda: machine.packet(message))

    def _result(self, machine: ModelMachine, message: Result | ResultEnd) -> None:
        self._carried(lambda: self.reducer.receive(lambda: self.reducer.take(message)), machine.name)

    def _acknowledge(self, substream: Substream, sequences: list[int]) -> None:
        self.noted.acknowledged.setdefault(substream, set()).update(sequences)
        machine = self.machines[substream.detector.partition(":")[0]]
        self._carried(lambda: machine.receive(lambda: machine.safe(substream, sequences)), machine.name)

    # --- orders

    def _carry_out(self, order: Order) -> None:
        match order:
            case Run():
                machine = self.machines[order.machine]
                self._carried(lambda: machine.receive(lambda: machine.run(order)), machine.name)
            case Send():
                source = self.sources[order.epoch.stream]
                self._carried(lambda: source.receive(lambda: source.send(order)), source.name)
            case Expect():
                self._carried(lambda: self.reducer.receive(lambda: self.reducer.expect(order)), REDUCER)
            case Finish():
                self._carried(lambda: self.reducer.receive(self._finish), REDUCER)
            case Restart():
                self._restart(order)
            case Say():
                self.noted.said.append((self.timeline.now, order))

    def _finish(self) -> None:
        self.reducer.finished = True
        self.reducer.report()

    def _restart(self, order: Restart) -> None:
        self.noted.restarts.append((self.timeline.now, order.actor))
        process = self._processes()[order.actor]
        process.kill()

        def boot() -> None:
            if self._impossible_until.get(order.actor, 0.0) > self.timeline.now:
                self._report(Gone(order.actor, order.incarnation, "no node plays its site"))
            else:
                process.start(order.incarnation)

        self.timeline.after(self._delay_s(self._network.boot_s), boot)

    # --- faults

    def _note_crash(self, broken: list[Substream]) -> None:
        self.noted.crashed += [(self.timeline.now, key) for key in broken]

    def _strike(self, fault: Fault) -> None:
        if fault.kind == "part":
            self._part(fault)
            return
        if fault.kind in ("rate", "down", "cut"):
            self._strike_link(fault)
            return
        process = self._processes()[fault.target]
        if fault.kind != "crash" and process.alive and not process.stopped and self._is_up(fault.target):
            self.noted.struck.append(fault)
        if fault.kind == "crash":
            machine = self.machines[fault.target.partition(":")[2]]
            machine.receive(lambda: self._note_crash(machine.break_detector(int(fault.number))))
        elif fault.kind == "stop" and process.alive:
            process.stop()
            incarnation = process.incarnation
            self.timeline.after(
                fault.duration_s, lambda: process.go_on() if process.incarnation == incarnation else None
            )
        elif fault.kind == "kill" and process.alive:
            self._kill(process, fault)

    def _is_up(self, actor: str) -> bool:
        """Whether the controller counts on an actor that has not done its work yet."""
        state, (kind, _, name) = self.scheduler.state, actor.partition(":")
        if kind == "machine":
            return state.machines[name].peer.is_up
        if kind == "source":
            return state.streams[name].source.is_up and not state.streams[name].ended
        return kind == "reducer" and state.reducer.peer.is_up

    def _kill(self, process: Process, fault: Fault) -> None:
        incarnation = process.incarnation
        process.kill()
        if process is self.scheduler:
            self.timeline.after(self._delay_s(self._network.boot_s), lambda: process.start(incarnation + 1))
            return
        if process is not self.reducer and fault.target.startswith("machine:"):
            self._impossible_until[fault.target] = self.timeline.now + fault.duration_s
        gone = Gone(fault.target, incarnation, "killed")
        self.timeline.after(self._delay_s(self._network.gone_s), lambda: self._tell_gone(gone))

    def _tell_gone(self, gone: Gone) -> None:
        """Its node says so once it can be heard."""
        if self._parted[self._site_of(gone.actor)]:
            self.timeline.after(self._network.delay_s[1], lambda: self._tell_gone(gone))
        else:
            self._report(gone)

    def _part(self, fault: Fault) -> None:
        site = fault.target.partition(":")[2]
        self._parted[site] += 1
        between = [
            f"{stream}>{to}"
            for stream, source in self.sources.items()
            for to in source.links
            if (self._home_of(stream) == site) != (to == site)
        ]
        for link in between:
            self._strike_link(replace(fault, kind="down", target=link))
        self.timeline.after(fault.duration_s, lambda: self._parted.subtract([site]))

    def _strike_link(self, fault: Fault) -> None:
        stream, _, site = fault.target.partition(">")
        link = self.sources[stream].links[site]
        if fault.kind == "cut":
            link.cut()
            return
        before = link.rate_bps
        link.rate_bps = 0.0 if fault.kind == "down" else before * fault.number
        changed = link.rate_bps

        def back() -> None:
            link.rate_bps += before - changed

        self.timeline.after(fault.duration_s, back)


def _speaker(event: Event) -> str:
    """Who says it; that a process has ended, its node says."""
    match event:
        case MachineReport():
            return machine_actor(event.machine)
        case SourceReport():
            return source_actor(event.stream)
        case Gone():
            return event.actor
        case _:
            return REDUCER
