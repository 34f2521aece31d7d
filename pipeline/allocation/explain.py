"""Why there is no plan: a minimal set of limits that clash, and the smallest change of each that helps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

from pipeline.allocation import decomposed
from pipeline.allocation.movable_limits import Limit, Step, limits
from pipeline.allocation.plan import Plan
from pipeline.allocation.problem import Problem
from pipeline.errors import NoPlanError

RELAXATION_TIME_LIMIT_S = 5.0
_MOST_NAMES = 8


class Solve(Protocol):
    """What every solver of the room looks like."""

    def __call__(
        self, problem: Problem, *, time_limit_s: float, workers: int = ..., seed: int = ...
    ) -> Plan: ...


@dataclass(frozen=True)
class Explanation:
    """limits: a minimal set that clashes, by name; empty if lifting every limit would not help. proven: that
    it is minimal. changes: what would be enough by itself, everything else as it is; one for each of the
    named limits of which a change can be enough.
    """

    limits: tuple[str, ...]
    proven: bool
    changes: tuple[str, ...]
    text: str


def explain(
    problem: Problem, *, solve: Solve = decomposed.solve, time_limit_s: float = RELAXATION_TIME_LIMIT_S
) -> Explanation:
    """A minimal set of clashing limits of a problem without a plan, and what would make one possible.

    Minimal: with all other limits lifted the set still clashes, and without any one of its members it does
    not. ``time_limit_s`` is for each of the relaxations solved: one per stream, one per machine, two, and
    some twenty per change. Where one is undecided by then, its limit stays in the set and the text says so.
    Raises ValueError if there is a plan.
    """
    if _feasibility(problem, solve, time_limit_s).assignments:
        raise ValueError("the problem has a plan")
    clash, decided = clashing_limits(problem, solve=solve, time_limit_s=time_limit_s)
    changes = [
        change
        for limit in clash[:_MOST_NAMES]
        if (change := smallest_change(problem, limit, solve=solve, time_limit_s=time_limit_s)) is not None
    ]
    names = [limit.name for limit in clash]
    return Explanation(tuple(names), decided, tuple(changes), _text(problem, names, decided, changes))


def clashing_limits(
    problem: Problem, *, solve: Solve = decomposed.solve, time_limit_s: float = RELAXATION_TIME_LIMIT_S
) -> tuple[list[Limit], bool]:
    """The minimal set of ``explain``, and whether it is proven; empty if lifting every limit would not help.

    The deletion filter: a limit that can be lifted while there is still no plan is not to blame.
    """
    kept: list[Limit] = []
    decided = True
    for limit in limits(problem):
        lifted = limit.lift(problem)
        status = _feasibility(lifted, solve, time_limit_s).status
        decided = decided and status != "unknown"
        if status == "infeasible":
            problem = lifted
        else:
            kept.append(limit)
    return kept, decided


def smallest_change(
    problem: Problem,
    limit: Limit,
    *,
    solve: Solve = decomposed.solve,
    time_limit_s: float = RELAXATION_TIME_LIMIT_S,
) -> str | None:
    """The smallest change of this limit that makes a plan possible while all others stay, in words.

    None if none does. A stream has a link per site: of these the one that needs the least more.
    """
    found = []
    for step in limit.steps:
        value = _least(problem, step, solve, time_limit_s)
        if value is not None:
            found.append((value - step.now, step.words(value)))
    return min(found)[1] if found else None


def _least(problem: Problem, step: Step, solve: Solve, time_limit_s: float) -> int | None:
    """The least value of a step that makes a plan possible, by bisection (more never hurts)."""

    def possible(value: int) -> bool:
        return bool(_feasibility(step.set(problem, value), solve, time_limit_s).assignments)

    low, high = step.now, step.most
    if high <= low or not possible(high):
        return None
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if possible(middle) else (middle, high)
    return high


def _feasibility(problem: Problem, solve: Solve, time_limit_s: float) -> Plan:
    """Solve for any plan at all: when nothing is worth anything the first plan is optimal."""
    worthless = tuple(replace(d, accuracy=(0.0,) * len(d.accuracy)) for d in problem.detectors)
    bare = replace(problem, detectors=worthless, accuracy_weight=1.0, stream_accuracy={})
    try:
        return solve(bare, time_limit_s=time_limit_s)
    except NoPlanError:  # too large a relaxation to decide
        return Plan("unknown", None, None, None, problem.cycle, (), 0.0, 0, 0)


def _text(problem: Problem, names: list[str], decided: bool, changes: list[str]) -> str:
    if not names:
        return _too_slow(problem)
    named = names[:_MOST_NAMES]
    if len(names) > _MOST_NAMES:
        named.append(f"and {len(names) - _MOST_NAMES} more")
    doubt = "" if decided else " (perhaps fewer of them: the search ran out of time)"
    remedy = f"; enough by itself: {', or '.join(changes)}" if changes else ""
    return f"these limits cannot hold together: {'; '.join(named)}{doubt}{remedy}"


def _too_slow(problem: Problem) -> str:
    """With every limit lifted the periods are left: it takes p detectors of period p to see every frame."""
    fastest = min(problem.detectors, key=lambda d: d.period, default=None)
    what = (
        "there is no detector"
        if fastest is None
        else f"{len(problem.detectors)} detectors, the fastest ({fastest.id}) one frame in {fastest.period}, "
        "together cannot look at every frame"
    )
    return f"{what} at {problem.frame_rate_hz:g} Hz; lower frame_rate, or add machines or faster detectors"
