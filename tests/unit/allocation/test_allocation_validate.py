"""Each limit that a plan can break is found by the independent check."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from pipeline.allocation.plan import Assignment, Plan, objective
from pipeline.allocation.problem import Problem
from pipeline.allocation.validate import validate


@pytest.fixture
def problem(tiny: Callable[..., Problem]) -> Problem:
    return tiny(("a", 2, 0.8, 2.0), ("b", 2, 0.6, 2.0), ("c", 1, 0.3, 9.0), link_mbps=4.0)


def use(name: str, period: int, phase: int, bitrate_bps: float = 4e6) -> Assignment:
    return Assignment("v", f"m:{name}", name, "m", "s", period, phase, bitrate_bps)


def plan_of(problem: Problem, *assignments: Assignment) -> Plan:
    try:
        value = objective(problem, assignments)
    except (KeyError, ValueError):
        value = 0.0
    return Plan("optimal", value, value, 0.0, problem.cycle, assignments, 0.0, 0, 0)


def test_a_plan_that_keeps_all_limits_has_no_fault(problem: Problem) -> None:
    assert validate(problem, plan_of(problem, use("a", 2, 0), use("b", 2, 1))) == []


@pytest.mark.parametrize(
    ("assignments", "fault"),
    [
        ((), "v frame 0: 0 detectors"),
        ((use("a", 2, 0),), "v frame 1: 0 detectors"),
        ((use("a", 2, 0), use("b", 2, 0)), "v frame 1: 0 detectors"),
        ((use("a", 2, 0), use("b", 2, 2)), "phase 2 outside 0 .. 1"),
        ((use("a", 2, 0), use("a", 2, 1)), "v uses m:a 2 times"),
        ((use("a", 2, 0), use("b", 2, 1), use("c", 1, 0, 1e6)), "3 detectors, at most 2"),
        ((use("a", 2, 0, 1e6), use("c", 1, 0)), "link v -> s: 4.5e+06 bps over 4e+06 bps"),
        ((use("a", 2, 0, 1e6), use("c", 1, 0, 1e6)), "machine m: 1.1e+10 bytes of 1e+10"),
        ((use("a", 1, 0),), "is not what the problem says"),
        ((use("nobody", 1, 0),), "detector m:nobody: not in the problem"),
        ((use("c", 1, 0, 3e6),), "bitrate 3e+06 bps is no level"),
        ((replace(use("c", 1, 0), stream="w"),), "stream w: not in the problem"),
    ],
)
def test_a_broken_limit_is_named(problem: Problem, assignments: tuple[Assignment, ...], fault: str) -> None:
    assert any(fault in found for found in validate(problem, plan_of(problem, *assignments)))


def test_more_detectors_than_a_frame_may_have_are_named(problem: Problem) -> None:
    one = replace(problem, detectors_per_frame=1)
    faults = validate(one, plan_of(one, use("a", 2, 0), use("c", 1, 0, 1e6)))
    assert any("v frame 0: 2 detectors, not 1 to 1" in fault for fault in faults)


def test_two_detectors_on_a_machine_that_allows_one_are_named(problem: Problem) -> None:
    one = replace(problem, memory_rule="one_detector_per_machine")
    assert validate(one, plan_of(one, use("a", 2, 0), use("b", 2, 1))) == [
        "machine m: 2 detectors, 1 is allowed"
    ]


def test_an_objective_that_the_assignments_are_not_worth_is_named(problem: Problem) -> None:
    good = plan_of(problem, use("a", 2, 0), use("b", 2, 1))
    assert good.objective is not None
    boast = replace(good, objective=good.objective + 1e-3, bound=good.objective + 1e-3)
    assert any("the assignments are worth" in fault for fault in validate(problem, boast))
    assert any("below the objective" in f for f in validate(problem, replace(good, bound=-9.0)))


def test_an_answer_without_a_plan_must_assign_nothing(problem: Problem) -> None:
    none = Plan("infeasible", None, None, None, problem.cycle, (), 0.0, 0, 0)
    assert validate(problem, none) == []
    assert validate(problem, replace(none, assignments=(use("a", 2, 0),)))
