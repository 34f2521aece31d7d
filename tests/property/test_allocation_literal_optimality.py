"""The literal program against enumeration of every choice, on problems small enough for it."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.allocation import literal
from pipeline.allocation.explain import clashing_limits
from pipeline.allocation.movable_limits import limits
from pipeline.allocation.problem import Detector, MachineLimit, Problem
from pipeline.allocation.validate import validate

BITRATES = (1e6, 2e6)
STREAMS = ("v", "w")


@st.composite
def problems(draw: st.DrawFn) -> Problem:
    """1-2 streams, 1-2 sites, 1-3 machines, 2-3 detectors of period 1-3, links of zero to infinity."""
    sites = ("s", "t")[: draw(st.integers(1, 2))]
    machines = tuple(
        MachineLimit(name, draw(st.sampled_from(sites)), draw(st.integers(2, 9)) * 1e9)
        for name in ("m", "n", "o")[: draw(st.integers(1, 3))]
    )
    streams = STREAMS[: draw(st.integers(1, 2))]
    return Problem(
        streams=streams,
        sites=sites,
        machines=machines,
        detectors=tuple(
            draw(detectors(name, machines)) for name in ("a", "b", "c")[: draw(st.integers(2, 3))]
        ),
        bitrates_bps=BITRATES,
        link_bps={
            (stream, site): draw(st.sampled_from((math.inf, 4e6, 3e6, 2e6, 1.5e6, 1e6, 0.5e6, 0.0)))
            for stream in streams
            for site in sites
        },
        frame_rate_hz=10.0,
        detectors_per_stream=draw(st.sampled_from((2, 3, 1))),
        detectors_per_frame=draw(st.sampled_from((2, 3, 1))),
        accuracy_weight=draw(st.sampled_from((0.0, 0.3, 0.6, 0.9, 1.0))),
        memory_rule=draw(st.sampled_from(("ram", "ram", "ram", "one_detector_per_machine"))),
    )


@st.composite
def detectors(draw: st.DrawFn, name: str, machines: tuple[MachineLimit, ...]) -> Detector:
    machine = draw(st.sampled_from(machines))
    accuracy = tuple(draw(st.integers(0, 10)) / 10 for _ in BITRATES)
    memory = draw(st.sampled_from((1e9, 2e9, 3e9)))
    period = draw(st.sampled_from((1, 1, 1, 2, 2, 3)))
    return Detector(f"{machine.id}:{name}", name, machine.id, machine.site, period, memory, accuracy, 0.1)


def best_objective(problem: Problem) -> float | None:
    """The greatest objective over every choice of detectors, bitrates and phases; None if none is allowed."""
    best: float | None = None
    for used in itertools.product(*(stream_choices(problem, stream).items() for stream in problem.streams)):
        if memory_suffices(problem, [detectors for detectors, _ in used]):
            total = sum(value for _, value in used)
            best = total if best is None else max(best, total)
    return best


def stream_choices(problem: Problem, stream: str) -> dict[tuple[Detector, ...], float]:
    """The best value of a stream for each set of detectors that it may use."""
    best: dict[tuple[Detector, ...], float] = {}
    uses = [
        [None, *((d, level, phase) for level in range(len(BITRATES)) for phase in range(d.period))]
        for d in problem.detectors
    ]
    for choice in itertools.product(*uses):
        chosen = [use for use in choice if use is not None]
        if stream_allows(problem, stream, chosen):
            detectors_used = tuple(d for d, _, _ in chosen)
            value = worth(problem, chosen)
            best[detectors_used] = max(value, best.get(detectors_used, -math.inf))
    return best


def stream_allows(problem: Problem, stream: str, chosen: list[tuple[Detector, int, int]]) -> bool:
    if len(chosen) > problem.detectors_per_stream:
        return False
    for frame in range(6):  # every period here divides 6
        looks = sum(frame % d.period == phase for d, _, phase in chosen)
        if not 1 <= looks <= problem.detectors_per_frame:
            return False
    for site in problem.sites:
        sent = sum(BITRATES[level] / d.period for d, level, _ in chosen if d.site == site)
        if sent > problem.link_bps[stream, site] + 1e-3:
            return False
    return True


def worth(problem: Problem, chosen: list[tuple[Detector, int, int]]) -> float:
    accuracy = sum(BITRATES[level] / BITRATES[-1] / d.period * d.accuracy[level] for d, level, _ in chosen)
    sites = {d.site for d, _, _ in chosen}
    return problem.accuracy_weight * accuracy - (1 - problem.accuracy_weight) * len(sites)


def memory_suffices(problem: Problem, used: list[tuple[Detector, ...]]) -> bool:
    for machine in problem.machines:
        here = [d for of_stream in used for d in of_stream if d.machine == machine.id]
        if problem.memory_rule == "one_detector_per_machine":
            if len(here) > 1:
                return False
        elif sum(d.memory_bytes for d in here) > machine.memory_bytes:
            return False
    return True


@settings(max_examples=120, deadline=None, derandomize=True)
@given(problems())
def test_the_literal_program_finds_what_enumeration_finds(problem: Problem) -> None:
    plan = literal.solve(problem, time_limit_s=30.0)
    best = best_objective(problem)
    assert plan.status == ("infeasible" if best is None else "optimal")
    assert validate(problem, plan) == []
    if best is not None:
        assert plan.objective == pytest.approx(best, abs=1e-8)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(problems(), st.integers(0, 3))
def test_a_wider_link_never_makes_the_plan_worse(problem: Problem, which: int) -> None:
    pairs = sorted(problem.link_bps)
    wider = dict(problem.link_bps) | {pairs[which % len(pairs)]: math.inf}
    before = literal.solve(problem, time_limit_s=30.0)
    after = literal.solve(replace(problem, link_bps=wider), time_limit_s=30.0)
    if before.objective is not None:
        assert after.objective is not None
        assert after.objective >= before.objective - 1e-8


@settings(max_examples=40, deadline=None, derandomize=True)
@given(problems())
def test_the_limits_named_clash_together_and_not_without_any_one_of_them(problem: Problem) -> None:
    if best_objective(problem) is not None:
        return
    clash, proven = clashing_limits(problem, time_limit_s=30.0)
    assert proven
    alone = problem
    for limit in limits(problem):
        if limit.name not in [c.name for c in clash]:
            alone = limit.lift(alone)
    assert literal.solve(alone, time_limit_s=30.0).status == "infeasible"
    assert all(literal.solve(c.lift(alone), time_limit_s=30.0).status == "optimal" for c in clash)
