"""The answer of planning again: a plan for the streams that can be served, and why the others are not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from pipeline.allocation.checked import checked
from pipeline.allocation.decomposed import kept_of, still_there
from pipeline.allocation.plan import Assignment, Plan
from pipeline.allocation.problem import Problem

#: by stream, the greater the more it matters; 0 for a stream that is not named
Priorities = Mapping[str, int]
NO_PRIORITIES: Priorities = MappingProxyType({})


@dataclass(frozen=True)
class Unserved:
    """A stream that the plan leaves out, and the limit that leaves it out, in one line."""

    stream: str
    reason: str


@dataclass(frozen=True)
class PlannedAgain:
    """A plan for a changed problem.

    plan: of the streams served; ``validate(problem, plan)`` is empty. Its bound and gap are to the best plan
    for the same streams, however much it moves. problem: the one asked for, with the streams served alone.
    unserved: the others, in the problem's order. kept, begun: substreams of the plan that go on, and that are
    new. ended: those of the running plan that do not go on. proven: that no plan serves the priorities
    better, and that none within the loss ends fewer substreams.
    """

    plan: Plan
    problem: Problem
    unserved: tuple[Unserved, ...]
    kept: tuple[Assignment, ...]
    ended: tuple[Assignment, ...]
    begun: tuple[Assignment, ...]
    proven: bool

    @property
    def gap(self) -> float:
        """See ``Plan.gap``."""
        return self.plan.gap or 0.0

    @property
    def text(self) -> str:
        """What was found, in one line, and one more for each stream unserved."""
        streams = len(self.problem.streams)
        proof = "proven" if self.proven else f"not proven, gap {self.gap:.2%}"
        first = (
            f"{streams} of {streams + len(self.unserved)} streams served ({proof}); {len(self.kept)} "
            f"substreams go on, {len(self.ended)} end, {len(self.begun)} begin"
        )
        return "\n".join(
            [first, *(f"stream {one.stream} is not served: {one.reason}" for one in self.unserved)]
        )


def ranks_of(streams: Sequence[str], priorities: Priorities) -> dict[str, int]:
    """0 for the streams of the greatest priority, 1 for those of the next, and so on."""
    ordered = sorted({priorities.get(stream, 0) for stream in streams}, reverse=True)
    return {stream: ordered.index(priorities.get(stream, 0)) for stream in streams}


def served_only(problem: Problem, assignments: Sequence[Assignment]) -> Problem:
    """The problem without the streams that are assigned nothing."""
    served = {a.stream for a in assignments}
    return replace(problem, streams=tuple(stream for stream in problem.streams if stream in served))


def planned(
    problem: Problem,
    running: Sequence[Assignment],
    plan: Plan,
    reasons: Mapping[str, str],
    *,
    proven: bool,
) -> PlannedAgain:
    """The record of a plan for some of the streams. reasons: for every other stream.

    Raises InvalidPlanError for a plan that breaks a limit.
    """
    served = served_only(problem, plan.assignments)
    on = kept_of(plan.assignments) & kept_of(still_there(problem, running))
    return PlannedAgain(
        checked(served, plan),
        served,
        tuple(Unserved(v, reasons[v]) for v in problem.streams if v not in served.streams),
        tuple(a for a in plan.assignments if key_of(a) in on),
        tuple(a for a in running if key_of(a) not in on or a.stream not in served.streams),
        tuple(a for a in plan.assignments if key_of(a) not in on),
        proven,
    )


def key_of(a: Assignment) -> tuple[str, str, float, str]:
    """What a substream keeps while it goes on (see ``replan``)."""
    return a.stream, a.detector, a.bitrate_bps, a.codec
