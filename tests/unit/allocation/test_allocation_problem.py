"""The problem's own arithmetic: gains, levels, and the way of a frame to its result."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from pipeline.allocation import decomposed
from pipeline.allocation.plan import Assignment, Plan
from pipeline.allocation.problem import Deadline, Problem
from pipeline.allocation.validate import validate

Tiny = Callable[..., Problem]


def test_a_gain_is_bitrate_over_period_times_accuracy(tiny: Tiny) -> None:
    problem = tiny(("a", 2, 0.8, 1.0))
    (detector,) = problem.detectors
    assert problem.gain("v", detector, 0) == pytest.approx(0.25 / 2 * 0.4)
    assert problem.gain("v", detector, 1) == pytest.approx(1.0 / 2 * 0.8)
    own = replace(problem, stream_accuracy={("v", "a"): (0.1, 0.2)})
    assert own.gain("v", detector, 1) == pytest.approx(1.0 / 2 * 0.2)
    assert own.gain("w", detector, 1) == pytest.approx(1.0 / 2 * 0.8)


def test_a_result_takes_encoding_transfer_decoding_and_execution(tiny: Tiny) -> None:
    """1 Mbps at 10 Hz are 0.1 Mbit a frame; twice that at most, over 2 Mbps: 0.1 s."""
    problem = tiny(("a", 2, 0.8, 1.0), link_mbps=2.0, deadline=Deadline(1.0, 0.01, 0.02, 2.0))
    (detector,) = problem.detectors
    assert problem.result_s("v", detector, 0) == pytest.approx(0.01 + 0.1 + 0.02 + 0.2)
    at_home = replace(problem, link_bps={("v", "s"): math.inf})
    assert at_home.result_s("v", detector, 0) == pytest.approx(0.2)
    nowhere = replace(problem, link_bps={})
    assert math.isinf(nowhere.result_s("v", detector, 0))


def test_a_deadline_takes_the_level_that_still_arrives(tiny: Tiny) -> None:
    problem = tiny(("a", 1, 0.8, 1.0), link_mbps=8.0)
    assert decomposed.solve(problem, time_limit_s=5.0).assignments[0].bitrate_bps == 4e6
    timely = replace(
        problem, deadline=Deadline(0.1 + 0.02)
    )  # 4 Mbps takes 0.05 s of the link, 1 Mbps 0.0125 s
    assert decomposed.solve(timely, time_limit_s=5.0).assignments[0].bitrate_bps == 1e6
    assert decomposed.solve(replace(problem, deadline=Deadline(0.1)), time_limit_s=5.0).status == "infeasible"


def test_two_detectors_that_slow_each_other_down_get_a_machine_each(tiny: Tiny) -> None:
    """Alone each sees every second frame; together on one machine only every fourth."""
    base = tiny(("a", 2, 0.8, 1.0), streams=("v",))
    alone = replace(base.detectors[0], id="m:a@1", sharing=1)
    together = replace(alone, id="m:a@2", sharing=2, period=4)
    one = replace(base, detectors=(alone, together))
    assert decomposed.solve(one, time_limit_s=5.0).status == "infeasible"
    machines = (*base.machines, replace(base.machines[0], id="n"))
    elsewhere = tuple(replace(d, id=d.id.replace("m:", "n:"), machine="n") for d in one.detectors)
    two = replace(one, machines=machines, detectors=(*one.detectors, *elsewhere))
    plan = decomposed.solve(two, time_limit_s=5.0)
    assert plan.status == "optimal"
    assert {a.machine for a in plan.assignments} == {"m", "n"}
    assert validate(two, plan) == []


def test_the_check_finds_what_is_late_and_what_shares_too_much(tiny: Tiny) -> None:
    problem = tiny(("a", 1, 0.8, 1.0), ("b", 1, 0.8, 1.0), link_mbps=8.0)
    both = tuple(Assignment("v", d.id, d.detector, "m", "s", 1, 0, 4e6) for d in problem.detectors)
    plan = Plan("optimal", 0.56, 0.56, 0.0, 1, both, 0.0, 0, 0)
    assert validate(problem, plan) == []
    late = validate(replace(problem, deadline=Deadline(0.12)), plan)
    assert late == [f"v on m:{n}: 0.15 s to a result, 0.12 s allowed" for n in "ab"]
    lonely = replace(problem, detectors=tuple(replace(d, sharing=1) for d in problem.detectors))
    assert validate(lonely, plan) == [f"m:{n}: one of 2 on its machine, its times hold for 1" for n in "ab"]
