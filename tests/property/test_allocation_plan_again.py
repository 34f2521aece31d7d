"""Planning again for whom it is possible: against every set of streams, and the laws of what goes on."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_allocation_decomposed_optimality import problems
from test_allocation_replan_valid import QUIET, changed, problems_of_every_kind

from pipeline.allocation import again, decomposed, literal
from pipeline.allocation.again import first_valid, plan_again
from pipeline.allocation.plan import Assignment
from pipeline.allocation.planned_again import NO_PRIORITIES, PlannedAgain, Priorities
from pipeline.allocation.problem import MachineLimit, Problem
from pipeline.allocation.validate import validate

PRIORITIES = st.lists(st.integers(0, 2), min_size=4, max_size=4).map(
    lambda of: {f"v{i}": priority for i, priority in enumerate(of)}
)


def best_by_trying(problem: Problem, priorities: Priorities) -> tuple[list[int], float]:
    """How many streams of each priority, the greatest first, the best plan serves, and its objective."""
    levels = sorted({priorities.get(v, 0) for v in problem.streams}, reverse=True)
    found: tuple[list[int], float] = ([0] * len(levels), 0.0)
    for n in range(1, len(problem.streams) + 1):
        for served in itertools.combinations(problem.streams, n):
            plan = decomposed.solve(replace(problem, streams=served), time_limit_s=20.0)
            if plan.objective is not None:
                counts = [sum(priorities.get(v, 0) == level for v in served) for level in levels]
                found = max(found, (counts, plan.objective))
    return found


def counts_of(problem: Problem, found: PlannedAgain, priorities: Priorities) -> list[int]:
    levels = sorted({priorities.get(v, 0) for v in problem.streams}, reverse=True)
    return [sum(priorities.get(v, 0) == level for v in found.problem.streams) for level in levels]


@pytest.fixture(autouse=True)
def no_mending(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plan is valid by itself: an invalid one fails, instead of being replaced."""

    class Failing:
        def warning(self, event: str, **fields: object) -> None:
            raise AssertionError(f"{event}: {fields}")

    monkeypatch.setattr(again, "_LOG", Failing())


def is_whole(problem: Problem, running: tuple[Assignment, ...], found: PlannedAgain) -> None:
    """The record says what its plan is."""
    assert validate(found.problem, found.plan) == []
    assert {a.stream for a in found.plan.assignments} == set(found.problem.streams)
    assert [*found.problem.streams] == [v for v in problem.streams if v in found.problem.streams]
    assert {one.stream for one in found.unserved} | set(found.problem.streams) == set(problem.streams)
    assert len(found.unserved) + len(found.problem.streams) == len(problem.streams)
    assert all(one.reason and "\n" not in one.reason for one in found.unserved)
    assert len(found.kept) + len(found.ended) == len(running)
    assert len(found.kept) + len(found.begun) == len(found.plan.assignments)


@settings(max_examples=150, **QUIET)
@given(problems_of_every_kind(), problems_of_every_kind(), PRIORITIES, st.sampled_from((0.0, 0.2)))
def test_any_plan_is_planned_again_for_any_problem(
    before: Problem, after: Problem, priorities: Priorities, loss: float
) -> None:
    running = decomposed.solve(before, time_limit_s=20.0).assignments
    at_once = first_valid(after, running, priorities=priorities, time_limit_s=20.0)
    found = plan_again(after, running, priorities=priorities, loss=loss, time_limit_s=20.0)
    is_whole(after, running, at_once)
    is_whole(after, running, found)
    assert counts_of(after, found, priorities) >= counts_of(after, at_once, priorities)


@settings(max_examples=150, **QUIET)
@given(st.data(), problems_of_every_kind(), PRIORITIES, st.sampled_from((0.0, 0.2)))
def test_a_changed_problem_is_planned_again(
    data: st.DataObject, before: Problem, priorities: Priorities, loss: float
) -> None:
    running = decomposed.solve(before, time_limit_s=20.0).assignments
    after = data.draw(changed(before))
    is_whole(after, running, first_valid(after, running, priorities=priorities, time_limit_s=20.0))
    is_whole(after, running, plan_again(after, running, priorities=priorities, loss=loss, time_limit_s=20.0))


def crowded(problem: Problem, share: float) -> Problem:
    """Memory so short that the streams are in each other's way."""
    machines = tuple(replace(m, memory_bytes=min(m.memory_bytes, 6e9) * share) for m in problem.machines)
    return replace(problem, machines=machines[: max(1, len(machines) // 2)], detectors=_on(problem, machines))


def _on(problem: Problem, machines: tuple[MachineLimit, ...]) -> tuple:  # type: ignore[type-arg]
    ids = {m.id for m in machines[: max(1, len(machines) // 2)]}
    return tuple(d for d in problem.detectors if d.machine in ids)


@settings(max_examples=150, **QUIET)
@given(problems(), st.sampled_from((1.0, 0.7, 0.5)), PRIORITIES)
def test_no_plan_serves_the_priorities_better(problem: Problem, share: float, priorities: Priorities) -> None:
    tight = crowded(problem, share)
    counts, value = best_by_trying(tight, priorities)
    found = plan_again(tight, (), priorities=priorities, loss=0.0, time_limit_s=20.0)
    assert counts_of(tight, found, priorities) == counts
    assert found.proven
    assert found.plan.objective == pytest.approx(value, abs=5e-7)
    assert found.plan.bound is not None
    assert found.plan.bound >= value - 5e-7
    at_once = first_valid(tight, (), priorities=priorities, time_limit_s=20.0)
    assert counts_of(tight, at_once, priorities) <= counts
    assert at_once.plan.bound is not None
    alone = decomposed.solve(at_once.problem, time_limit_s=20.0)
    assert alone.objective is not None
    assert at_once.plan.bound >= alone.objective - 5e-7


@st.composite
def touched(draw: st.DrawFn, problem: Problem) -> tuple[Problem, str, tuple[str, str], str]:
    """A machine, a link or a stream is lost: the problem after it, and which (empty: none)."""
    nothing = "", ("", ""), ""
    machine, link, stream = draw(
        st.sampled_from(
            [
                *((m.id, *nothing[1:]) for m in problem.machines),
                *(("", pair, "") for pair in sorted(problem.link_bps)),
                *(("", ("", ""), v) for v in problem.streams),
            ]
        )
    )
    after = replace(
        problem,
        streams=tuple(v for v in problem.streams if v != stream),
        machines=tuple(m for m in problem.machines if m.id != machine),
        detectors=tuple(d for d in problem.detectors if d.machine != machine),
        link_bps={pair: 0.0 if pair == link else bps for pair, bps in problem.link_bps.items()},
    )
    return after, machine, link, stream


@settings(max_examples=150, **QUIET)
@given(problems(), st.data(), st.sampled_from((0.0, 0.05, 0.3)))
def test_what_the_change_does_not_touch_goes_on_if_that_costs_no_more_than_the_loss(
    problem: Problem, data: st.DataObject, loss: float
) -> None:
    """Held against the paper's program with all untouched substreams fixed."""
    running = decomposed.solve(problem, time_limit_s=20.0).assignments
    after, machine, link, stream = data.draw(touched(problem))
    best = decomposed.solve(after, time_limit_s=20.0)
    untouched = [
        a for a in running if a.machine != machine and (a.stream, a.site) != link and a.stream != stream
    ]
    if best.objective is None or not untouched:
        return
    fixed = with_fixed(after, untouched)
    found = plan_again(after, running, loss=loss, time_limit_s=20.0)
    assert not found.unserved
    # equal optima may have different accuracy parts, all with a link for each stream at least
    accuracy = best.objective + (1.0 - after.accuracy_weight) * len(after.streams)
    if fixed is not None and fixed >= best.objective - loss * max(accuracy, 0.0) + 1e-6 * bool(loss):
        now = {(a.stream, a.detector, a.bitrate_bps) for a in found.plan.assignments}
        assert all((a.stream, a.detector, a.bitrate_bps) in now for a in untouched)


def with_fixed(problem: Problem, untouched: list[Assignment]) -> float | None:
    made = literal.build_model(problem)
    numbers = {d.id: i for i, d in enumerate(problem.detectors)}
    for a in untouched:
        level = problem.bitrates_bps.index(a.bitrate_bps)
        made.model.add(made.x[problem.streams.index(a.stream)][numbers[a.detector]][level] == 1)
    solver = literal.cp_model.CpSolver()
    solver.parameters.num_workers = 1
    status = solver.solve(made.model)
    return solver.objective_value * 1e-9 if status == literal.cp_model.OPTIMAL else None


@settings(max_examples=100, **QUIET)
@given(problems_of_every_kind())
def test_where_nothing_changed_nothing_moves(problem: Problem) -> None:
    running = decomposed.solve(problem, time_limit_s=20.0).assignments
    for found in (first_valid(problem, running), plan_again(problem, running, loss=0.0, time_limit_s=20.0)):
        if running:
            assert not found.ended
            assert not found.begun
            assert found.plan.assignments == running
    assert NO_PRIORITIES == {}


def can_be_served(problem: Problem, stream: str, **lifted: object) -> bool:
    alone = replace(problem, streams=(stream,), **lifted)  # type: ignore[arg-type]
    return bool(decomposed.solve(alone, time_limit_s=20.0).assignments)


@settings(max_examples=150, **QUIET)
@given(problems(), st.sampled_from((1.0, 0.7, 0.5)), PRIORITIES)
def test_the_limit_that_is_named_is_the_one_that_leaves_the_stream_out(
    problem: Problem, share: float, priorities: Priorities
) -> None:
    tight = crowded(problem, share)
    wide = {pair: max(bps, 1e13) for pair, bps in tight.link_bps.items()}
    boundless = tuple(replace(m, memory_bytes=float("inf")) for m in tight.machines)
    for one in plan_again(tight, (), priorities=priorities, time_limit_s=20.0).unserved:
        alone = can_be_served(tight, one.stream)
        assert alone == one.reason.startswith("the machines are full")
        if one.reason.startswith("its links carry too little"):
            assert can_be_served(tight, one.stream, link_bps=wide)
        elif not alone and not one.reason.startswith("it has no link"):
            assert not can_be_served(tight, one.stream, link_bps=wide)
        if one.reason.startswith("no detectors that together see every frame answer within"):
            assert can_be_served(tight, one.stream, deadline=None)
        if one.reason.startswith("the machines that it reaches have not the memory"):
            assert can_be_served(tight, one.stream, machines=boundless)
        if "exclude each other" in one.reason:
            assert can_be_served(tight, one.stream, link_bps=wide, machines=boundless, deadline=None)
        if one.reason.endswith("together see every frame at 10 Hz"):
            assert not can_be_served(tight, one.stream, link_bps=wide, machines=boundless, deadline=None)
