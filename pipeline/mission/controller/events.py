"""What the controller is told. A report says the whole of what its actor does, and that it lives."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.allocation.plan import Assignment
from pipeline.allocation.problem import Problem
from pipeline.mission.controller.substreams import Substream


@dataclass(frozen=True)
class LinkMeasure:
    """What a stream's link to a site lets through, bit/s; 0: nothing. Infinite: nothing was in its way."""

    site: str
    rate_bps: float


@dataclass(frozen=True)
class SourceReport:
    """Of the source of one stream.

    incarnation: how many processes it had before this one. epoch: number of the PlanEpoch that it follows, -1
    before the first. tick: next one to come. ended: it has sent the end of every substream, and captures no more.
    links: measured by what arrived.
    """

    stream: str
    incarnation: int
    epoch: int
    tick: int = 0
    ended: bool = False
    links: tuple[LinkMeasure, ...] = ()


@dataclass(frozen=True)
class FailedSubstream:
    """A substream whose detector broke on its machine, and why."""

    substream: Substream
    reason: str


@dataclass(frozen=True)
class MachineReport:
    """Of one machine. running: what it has begun to load or has loaded. ready: those that could take a packet now."""

    machine: str
    incarnation: int
    running: frozenset[Substream] = frozenset()
    ready: frozenset[Substream] = frozenset()
    failed: tuple[FailedSubstream, ...] = ()


@dataclass(frozen=True)
class ReducerReport:
    """Of the map's owner. open, closed: substreams whose opening and closing is on disk. finished: the map is out."""

    incarnation: int
    open: frozenset[Substream] = frozenset()
    closed: frozenset[Substream] = frozenset()
    finished: bool = False


@dataclass(frozen=True)
class Gone:
    """An actor's process has ended. actor: ``machine:M``, ``source:STREAM`` or ``reducer``."""

    actor: str
    incarnation: int
    reason: str


@dataclass(frozen=True)
class Unserved:
    """A stream that the plan gives nobody, and which limit is in its way, in words."""

    stream: str
    reason: str


@dataclass(frozen=True)
class Solved:
    """The solver's answer to a request. final: no better one follows. assignments: of all streams but the unserved."""

    request: int
    assignments: tuple[Assignment, ...]
    unserved: tuple[Unserved, ...] = ()
    final: bool = True


@dataclass(frozen=True)
class NotSolved:
    """The solver found nothing, or broke."""

    request: int
    reason: str


@dataclass(frozen=True)
class Elapsed:
    """Nothing but time has passed."""


@dataclass(frozen=True)
class StreamStopped:
    """The operator ends a stream."""

    stream: str


@dataclass(frozen=True)
class StreamPaused:
    """The operator lets a stream be looked at no more, or again."""

    stream: str
    paused: bool


@dataclass(frozen=True)
class ProblemChanged:
    """The inventory, the pool or the streams are others now; what is new in it is expected to report."""

    problem: Problem


@dataclass(frozen=True)
class MissionStopped:
    """The operator ends the mission: what was sent is still looked at."""


Event = (
    SourceReport
    | MachineReport
    | ReducerReport
    | Gone
    | Solved
    | NotSolved
    | Elapsed
    | StreamStopped
    | StreamPaused
    | ProblemChanged
    | MissionStopped
)
