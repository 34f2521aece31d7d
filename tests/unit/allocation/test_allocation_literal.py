"""The literal integer program: hand-checked optima, the paper's counts, repeatability."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from pipeline.allocation import literal
from pipeline.allocation.problem import Detector, MachineLimit, Problem
from pipeline.allocation.validate import validate
from pipeline.errors import NoPlanError

Tiny = Callable[..., Problem]
PaperInstance = Callable[[int, int, int], Problem]


def solve(problem: Problem) -> literal.Plan:
    plan = literal.solve(problem, time_limit_s=30.0)
    assert validate(problem, plan) == []
    return plan


def test_one_fast_detector_takes_every_frame_at_the_greatest_bitrate(tiny: Tiny) -> None:
    plan = solve(tiny(("fast", 1, 0.8, 2.0)))
    (a,) = plan.assignments
    assert (plan.status, a.phase, a.period, a.bitrate_bps) == ("optimal", 0, 1, 4e6)
    assert plan.objective == pytest.approx(0.6 * 0.8 - 0.4)
    assert plan.gap == 0.0
    assert plan.bound == plan.objective


def test_one_detector_of_period_two_cannot_take_every_frame(tiny: Tiny) -> None:
    plan = solve(tiny(("slow", 2, 0.8, 2.0)))
    assert (plan.status, plan.objective, plan.bound, plan.gap) == ("infeasible", None, None, None)
    assert plan.assignments == ()


def test_two_detectors_of_period_two_share_the_frames(tiny: Tiny) -> None:
    plan = solve(tiny(("a", 2, 0.8, 2.0), ("b", 2, 0.6, 2.0), detectors_per_frame=1))
    assert {a.phase for a in plan.assignments} == {0, 1}
    assert plan.objective == pytest.approx(0.6 * (0.8 + 0.6) / 2 - 0.4)


def test_periods_two_and_three_never_meet_the_limit_of_one_detector_per_frame(tiny: Tiny) -> None:
    detectors = (("a", 2, 0.8, 1.0), ("b", 3, 0.9, 1.0), ("c", 2, 0.7, 1.0))
    plan = solve(tiny(*detectors, detectors_per_frame=1, detectors_per_stream=3))
    assert {a.pool_detector for a in plan.assignments} == {"a", "c"}


def test_a_link_is_charged_the_bitrate_divided_by_the_period(tiny: Tiny) -> None:
    """4 Mbps for every second frame is 2 Mbps: two detectors of period 2 need a link of exactly 4 Mbps."""
    pair = (("a", 2, 0.8, 1.0), ("b", 2, 0.8, 1.0))
    assert {a.bitrate_bps for a in solve(tiny(*pair, link_mbps=4.0)).assignments} == {4e6}
    assert sorted(a.bitrate_bps for a in solve(tiny(*pair, link_mbps=3.9)).assignments) == [1e6, 4e6]
    assert solve(tiny(*pair, link_mbps=0.9)).status == "infeasible"


def test_a_missing_link_forbids_and_an_infinite_one_does_not_limit(tiny: Tiny) -> None:
    one = ("fast", 1, 0.8, 2.0)
    assert solve(tiny(one, link_bps={})).status == "infeasible"
    assert solve(tiny(one, link_bps={("v", "s"): math.inf})).assignments[0].bitrate_bps == 4e6


def test_memory_counts_every_stream_that_a_detector_serves(tiny: Tiny) -> None:
    streams = {"streams": ("v", "w"), "link_bps": {("v", "s"): 9e6, ("w", "s"): 9e6}}
    one = ("fast", 1, 0.8, 2.0)
    assert len(solve(tiny(one, machine_gb=4.0, **streams)).assignments) == 2
    assert solve(tiny(one, machine_gb=3.9, **streams)).status == "infeasible"


def test_one_detector_per_machine_ignores_memory_and_allows_one(tiny: Tiny) -> None:
    pair = (("a", 1, 0.8, 50.0), ("b", 1, 0.7, 50.0))
    plan = solve(tiny(*pair, memory_rule="one_detector_per_machine"))
    assert [a.pool_detector for a in plan.assignments] == ["a"]
    halves = (("a", 2, 0.8, 1.0), ("b", 2, 0.7, 1.0))
    assert solve(tiny(*halves, memory_rule="one_detector_per_machine")).status == "infeasible"


def test_a_detector_is_used_at_one_bitrate_only(tiny: Tiny) -> None:
    """Without ``sum_b x <= 1`` one detector of period 2 would be used twice, once per bitrate."""
    assert solve(tiny(("slow", 2, 0.8, 1.0), detectors_per_stream=4)).status == "infeasible"


def test_the_weight_balances_accuracy_against_links(tiny: Tiny) -> None:
    """A second site adds 0.9 accuracy for one more link: worth it if 0.9 w > 1 - w, that is w > 10 / 19."""
    two_sites = {
        "sites": ("s", "t"),
        "machines": (MachineLimit("m", "s", 1e10), MachineLimit("n", "t", 1e10)),
        "detectors": (
            Detector("m:a", "a", "m", "s", 1, 1e9, (0.5, 0.9), 0.1),
            Detector("n:a", "a", "n", "t", 1, 1e9, (0.5, 0.9), 0.1),
        ),
        "link_bps": {("v", "s"): 1e7, ("v", "t"): 1e7},
    }
    assert len(solve(tiny(**two_sites, accuracy_weight=0.53)).assignments) == 2
    assert len(solve(tiny(**two_sites, accuracy_weight=0.52)).assignments) == 1


@pytest.mark.parametrize(
    ("instance", "counts"),
    [
        ((1, 1, 8), (364, 91)),
        ((1, 2, 8), (728, 142)),
        ((1, 1, 9), (404, 91)),
        ((1, 2, 9), (808, 142)),
        ((1, 5, 8), (1820, 295)),
        ((1, 10, 8), (3640, 550)),
        ((1, 15, 8), (5460, 805)),
        ((2, 1, 8), (1304, 223)),
        ((2, 2, 8), (2608, 406)),
        ((2, 5, 8), (6520, 955)),
        ((3, 1, 8), (2384, 911)),
        ((5, 1, 8), (14284, 12469)),
        ((5, 50, 9), (724700, 621490)),
    ],
)
def test_counts_are_those_of_the_papers_evaluation_table(
    paper_instance: PaperInstance, instance: tuple[int, int, int], counts: tuple[int, int]
) -> None:
    """The table prints counts over 1,000 as '12k'; those here round to what it prints."""
    problem = paper_instance(*instance)
    assert (literal.number_of_variables(problem), literal.number_of_constraints(problem)) == counts


@pytest.mark.parametrize(("detectors_per_stream", "streams"), [(1, 3), (2, 2), (3, 1), (4, 1)])
def test_the_built_model_has_as_many_variables_and_constraints_as_the_formulas_say(
    paper_instance: PaperInstance, detectors_per_stream: int, streams: int
) -> None:
    problem = paper_instance(detectors_per_stream, streams, 8)
    built = literal.build_model(problem)
    assert len(built.model.proto.variables) == literal.number_of_variables(problem)
    assert len(built.model.proto.constraints) - built.added == literal.number_of_constraints(problem)
    assert built.added == len(problem.streams) * len(problem.detectors)


def test_the_cycle_of_the_papers_instance_is_the_printed_one(paper_instance: PaperInstance) -> None:
    sizes = [
        (paper_instance(dps, 1, 8).cycle, len(paper_instance(dps, 1, 8).detectors)) for dps in range(1, 6)
    ]
    assert sizes == [(1, 40), (2, 130), (6, 170), (12, 200), (60, 210)]


@pytest.mark.slow
def test_a_hundred_streams_fit_the_papers_machines_and_a_hundred_and_twenty_five_do_not(
    paper_instance: PaperInstance,
) -> None:
    assert solve(paper_instance(1, 100, 9)).status == "optimal"
    assert solve(paper_instance(1, 125, 9)).status == "infeasible"


def test_the_same_problem_gives_the_same_plan(paper_instance: PaperInstance) -> None:
    problem = paper_instance(2, 1, 8)
    first, second = (replace(solve(problem), solve_s=0.0) for _ in range(2))
    assert first == second


def test_two_workers_give_the_same_plan_again(tiny: Tiny) -> None:
    """Six equal detectors: any two of them are an optimum."""
    problem = tiny(*((name, 2, 0.8, 1.0) for name in "abcdef"), link_mbps=99.0)
    plans = [literal.solve(problem, time_limit_s=30.0, workers=2).assignments for _ in range(4)]
    assert plans == [plans[0]] * 4


def test_a_model_that_no_machine_could_hold_is_refused(tiny: Tiny) -> None:
    long_cycle = tiny(*((f"d{p}", p, 0.8, 1.0) for p in range(1, 17)), detectors_per_stream=16)
    assert long_cycle.cycle == 720720
    with pytest.raises(NoPlanError, match=r"11531553 variables.*720720 frames"):
        literal.solve(long_cycle, time_limit_s=1.0)


def test_an_ended_time_limit_says_unknown_and_assigns_nothing(paper_instance: PaperInstance) -> None:
    plan = literal.solve(paper_instance(3, 2, 8), time_limit_s=1e-6)
    assert (plan.status, plan.assignments, plan.objective) == ("unknown", (), None)


def test_assignments_are_ordered_by_stream_phase_and_detector(tiny: Tiny) -> None:
    plan = solve(tiny(("b", 2, 0.8, 1.0), ("a", 2, 0.6, 1.0)))
    keys = [(a.stream, a.phase, a.detector) for a in plan.assignments]
    assert keys == sorted(keys)
