"""What the controller wants. An order states the whole of what its actor should do; doing it twice changes nothing."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.allocation.plan import Assignment
from pipeline.allocation.problem import Problem
from pipeline.mission.controller.substreams import Opened, PlanEpoch, Substream, keys_of


@dataclass(frozen=True)
class Solve:
    """Plan for the world as it is. running: what the streams are looked at by now."""

    request: int
    problem: Problem
    running: tuple[Assignment, ...]


@dataclass(frozen=True)
class Run:
    """The substreams that a machine should hold, and no others.

    incarnation: of the process that this is for. number: of the order; one that comes after a higher one is void.
    """

    machine: str
    substreams: tuple[Opened, ...]
    incarnation: int = 0
    number: int = 0


@dataclass(frozen=True)
class Send:
    """What a source should follow from its next tick on.

    Substreams that the epoch before had too go on; new ones begin with a key frame; the others get their end.
    over: send the end of all and capture no more. incarnation: of the process that this is for; an epoch that comes
    after one with a higher number is void.
    """

    epoch: PlanEpoch
    over: bool = False
    incarnation: int = 0


@dataclass(frozen=True)
class Close:
    """A substream of which no more is taken, and why what is missing of it is lost."""

    substream: Substream
    reason: str


@dataclass(frozen=True)
class Expect:
    """The substreams that the reducer should hold open, and those that it should close now."""

    open: tuple[Opened, ...]
    close: tuple[Close, ...] = ()

    @property
    def keys(self) -> frozenset[Substream]:
        """The identities of those that should be open."""
        return keys_of(self.open)


@dataclass(frozen=True)
class Restart:
    """End the actor's process, if there is still one, and start the one with this number."""

    actor: str
    incarnation: int


@dataclass(frozen=True)
class Finish:
    """Nothing more will come: publish the map."""


@dataclass(frozen=True)
class Say:
    """One line for the operator and the time line of the mission."""

    what: str
    subject: str
    detail: str = ""


Order = Solve | Run | Send | Expect | Restart | Finish | Say
