"""Why there is no plan: a smallest set of limits that clash, found by dropping each limit in turn."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

from pipeline.allocation import literal
from pipeline.allocation.plan import Plan
from pipeline.allocation.problem import MachineLimit, Problem

RELAXATION_TIME_LIMIT_S = 5.0
_MOST_NAMES = 8


class Solve(Protocol):
    """What every solver of the room looks like."""

    def __call__(
        self, problem: Problem, *, time_limit_s: float, workers: int = ..., seed: int = ...
    ) -> Plan: ...


@dataclass(frozen=True)
class Limit:
    """Something that could be otherwise. name: as the user knows it. lift: the problem without it."""

    name: str
    lift: Callable[[Problem], Problem]


def explain(
    problem: Problem, *, solve: Solve = literal.solve, time_limit_s: float = RELAXATION_TIME_LIMIT_S
) -> str:
    """One line that names a minimal set of clashing limits of a problem without a plan.

    Minimal: with all other limits lifted the set still clashes, and without any one of its members it does
    not. ``time_limit_s`` is for each of the relaxations solved: one per stream, one per machine, and two.
    Where one is undecided by then, its limit stays in the set and the line says so. Raises ValueError if
    there is a plan.
    """
    if _feasibility(problem, solve, time_limit_s).assignments:
        raise ValueError("the problem has a plan")
    clash, decided = clashing_limits(problem, solve=solve, time_limit_s=time_limit_s)
    if not clash:
        return _too_slow(problem)
    names = [limit.name for limit in clash[:_MOST_NAMES]]
    if len(clash) > _MOST_NAMES:
        names.append(f"and {len(clash) - _MOST_NAMES} more")
    doubt = "" if decided else " (perhaps fewer of them: the search ran out of time)"
    return f"these limits cannot hold together: {'; '.join(names)}{doubt}"


def clashing_limits(
    problem: Problem, *, solve: Solve = literal.solve, time_limit_s: float = RELAXATION_TIME_LIMIT_S
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


def _feasibility(problem: Problem, solve: Solve, time_limit_s: float) -> Plan:
    """Solve for any plan at all: when nothing is worth anything the first plan is optimal."""
    worthless = tuple(replace(d, accuracy=(0.0,) * len(d.accuracy)) for d in problem.detectors)
    return solve(replace(problem, detectors=worthless, accuracy_weight=1.0), time_limit_s=time_limit_s)


def limits(problem: Problem) -> list[Limit]:
    """All limits; the mission's own numbers first, to blame links and machines where these suffice."""
    links = [
        Limit(_links_name(problem, stream), _lift_links(stream))
        for stream in problem.streams
        if any(math.isfinite(problem.link(stream, site)) for site in problem.sites)
    ]
    machines = [Limit(_machine_name(problem, m), _lift_machine(m.id)) for m in problem.machines]
    return [
        Limit(f"detectors_per_frame {problem.detectors_per_frame}", _lift_detectors_per_frame),
        Limit(f"detectors_per_stream {problem.detectors_per_stream}", _lift_detectors_per_stream),
        *links,
        *machines,
    ]


def _links_name(problem: Problem, stream: str) -> str:
    links = ", ".join(f"{_mbps(problem.link(stream, site))} to {site}" for site in problem.sites)
    return f"the links of stream {stream} ({links})"


def _mbps(bps: float) -> str:
    return "no limit" if math.isinf(bps) else f"{bps / 1e6:g} Mbps" if bps else "none"


def _machine_name(problem: Problem, machine: MachineLimit) -> str:
    if problem.memory_rule == "one_detector_per_machine":
        return f"one detector at a time on machine {machine.id} (memory_rule)"
    return f"the memory of machine {machine.id} ({machine.memory_bytes / 1e9:g} GB)"


def _lift_links(stream: str) -> Callable[[Problem], Problem]:
    def lift(problem: Problem) -> Problem:
        free = {(stream, site): math.inf for site in problem.sites}
        return replace(problem, link_bps={**problem.link_bps, **free})

    return lift


def _lift_machine(machine_id: str) -> Callable[[Problem], Problem]:
    def lift(problem: Problem) -> Problem:
        machines = tuple(
            replace(m, memory_bytes=math.inf) if m.id == machine_id else m for m in problem.machines
        )
        return replace(problem, machines=machines)

    return lift


def _lift_detectors_per_frame(problem: Problem) -> Problem:
    return replace(problem, detectors_per_frame=max(1, len(problem.detectors)))


def _lift_detectors_per_stream(problem: Problem) -> Problem:
    return replace(problem, detectors_per_stream=max(1, len(problem.detectors)))


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
