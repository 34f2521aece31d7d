"""All that the controller knows."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

from pipeline.allocation.problem import Problem
from pipeline.mission.controller.events import MachineReport, ReducerReport
from pipeline.mission.controller.links import LinkState, declared
from pipeline.mission.controller.orders import Order
from pipeline.mission.controller.params import ControllerParams
from pipeline.mission.controller.peers import Peer, starting
from pipeline.mission.controller.substreams import Opened, PlanEpoch, Substream

REDUCER = "reducer"


def machine_actor(machine: str) -> str:
    """The actor's name of a machine."""
    return f"machine:{machine}"


def source_actor(stream: str) -> str:
    """The actor's name of a stream's source."""
    return f"source:{stream}"


@dataclass(frozen=True)
class StreamState:
    """One stream.

    wanted: what the newest plan looks at it with. given: the epochs that its source may follow at this moment,
    ascending; the last one is the order that stands. reported: number of the epoch that it was last heard to follow.
    next_number: of its next epoch. unserved: why the plan gives it nobody. over: the operator has ended it.
    """

    source: Peer
    wanted: tuple[Opened, ...] = ()
    given: tuple[PlanEpoch, ...] = ()
    reported: int = -1
    next_number: int = 0
    tick: int = 0
    unserved: str | None = None
    paused: bool = False
    over: bool = False
    ended: bool = False

    @property
    def standing(self) -> PlanEpoch | None:
        """The epoch that its source was last ordered to follow."""
        return self.given[-1] if self.given else None

    @property
    def is_planned_for(self) -> bool:
        """Whether a plan should look at it."""
        return not (self.ended or self.over or self.paused)


@dataclass(frozen=True)
class MachineState:
    """One machine and its last report."""

    peer: Peer
    report: MachineReport


@dataclass(frozen=True)
class ReducerState:
    """The reducer and its last report."""

    peer: Peer
    report: ReducerReport


@dataclass(frozen=True)
class Known:
    """A substream that is not closed yet.

    given: its source was once ordered to send it. left_s: since when its source sends it no more. dead: why nobody
    will look at it any more.
    """

    opened: Opened
    given: bool = False
    left_s: float = math.inf
    dead: str | None = None


@dataclass(frozen=True)
class Asked:
    """A question to the solver that has no final answer. situation: what it was asked for."""

    request: int
    situation: object
    at_s: float


@dataclass(frozen=True)
class Given:
    """The last order to one actor, and when it was given."""

    order: Order
    at_s: float


@dataclass(frozen=True)
class MissionState:
    """The mission at one moment.

    problem: of the whole inventory; ``situation.problem_now`` is what is left of it. here: sites on the scheduler's own
    host, from which no radio parts it. requests: questions to the solver
    so far. situation: the one that the standing plan was made for. failures: how often each detector broke. given: the
    last order to each actor. begun_s, last_s: time of the first and of the last step.
    """

    problem: Problem
    params: ControllerParams
    machines: Mapping[str, MachineState]
    streams: Mapping[str, StreamState]
    reducer: ReducerState
    links: Mapping[tuple[str, str], LinkState]
    here: frozenset[str] = frozenset()
    known: Mapping[Substream, Known] = field(default_factory=dict)
    failures: Mapping[str, int] = field(default_factory=dict)
    given: Mapping[str, Given] = field(default_factory=dict)
    requests: int = 0
    asked: Asked | None = None
    situation: object = None
    begun_s: float = 0.0
    last_s: float = math.inf
    finished: bool = False


def begin(
    problem: Problem,
    now: float,
    params: ControllerParams | None = None,
    here: Collection[str] | None = None,
) -> MissionState:
    """The state before the first event: every actor is being started. here: see MissionState; None: all sites."""
    return MissionState(
        problem,
        params or ControllerParams(),
        machines={m.id: MachineState(starting(now), MachineReport(m.id, 0)) for m in problem.machines},
        streams={v: StreamState(starting(now)) for v in problem.streams},
        reducer=ReducerState(starting(now), ReducerReport(0)),
        links={link: declared(bps) for link, bps in problem.link_bps.items()},
        here=frozenset(problem.sites if here is None else here),
        begun_s=now,
        last_s=now,
    )


def with_machine(state: MissionState, machine: MachineState) -> MissionState:
    """The state with another state of one machine."""
    return replace(state, machines={**state.machines, machine.report.machine: machine})


def with_stream(state: MissionState, name: str, stream: StreamState) -> MissionState:
    """The state with another state of one stream."""
    return replace(state, streams={**state.streams, name: stream})
