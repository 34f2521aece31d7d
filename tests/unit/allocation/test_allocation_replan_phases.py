"""Phases of a plan made again: kept where they still cover, chosen anew where they do not; and the door."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from pipeline.allocation import decomposed
from pipeline.allocation import replan as replanning
from pipeline.allocation.checked import checked
from pipeline.allocation.covering import phases_near
from pipeline.allocation.plan import Assignment, Plan
from pipeline.allocation.problem import Detector, MachineLimit, Problem
from pipeline.allocation.replan import replan
from pipeline.allocation.validate import validate
from pipeline.errors import InvalidPlanError
from pipeline.sensor.setup import Setup


def problem(period: int, per_frame: int, per_stream: int = 4, machines: int = 4) -> Problem:
    """One stream at its own site, equal detectors on equal machines."""
    return Problem(
        streams=("v",),
        sites=("s",),
        machines=tuple(MachineLimit(f"m{i}", "s", math.inf) for i in range(machines)),
        detectors=tuple(
            Detector(f"m{i}:d", "d", f"m{i}", "s", period, 1e6, (0.9,), 0.1) for i in range(machines)
        ),
        bitrates_bps=(1e6,),
        link_bps={("v", "s"): math.inf},
        frame_rate_hz=10.0,
        detectors_per_stream=per_stream,
        detectors_per_frame=per_frame,
        accuracy_weight=0.9,
    )


def first(of: Problem) -> tuple[Assignment, ...]:
    return decomposed.solve(of, time_limit_s=10.0).assignments


def again(of: Problem, running: tuple[Assignment, ...], loss: float = 0.01) -> tuple[Assignment, ...]:
    found = replan(of, running, loss=loss, time_limit_s=10.0)
    assert validate(of, found.plan) == []
    return found.plan.assignments


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (problem(2, 3), problem(2, 2)),
        (problem(2, 2, 2), problem(1, 2, 2)),
        (problem(3, 1, 3), problem(2, 2, 3)),
        (problem(2, 1, 2), problem(4, 1, 4)),
        (problem(1, 2, 2), problem(3, 2, 4)),
        (problem(4, 1, 4), problem(1, 1, 1)),
    ],
)
def test_phases_that_no_longer_cover_are_chosen_anew(before: Problem, after: Problem) -> None:
    assert again(after, first(before))


def test_phases_that_still_cover_stay_whatever_they_are() -> None:
    """Turned by one frame: nothing that a fresh choice would give."""
    of = problem(3, 1, 3)
    turned = tuple(replace(a, phase=(a.phase + 1) % 3) for a in first(of))
    assert {(a.detector, a.phase) for a in again(of, turned)} == {(a.detector, a.phase) for a in turned}


@pytest.mark.parametrize("turn", [0, 1, 2])
def test_who_replaces_a_lost_detector_takes_its_phase(turn: int) -> None:
    of = problem(3, 1, 3)
    running = tuple(replace(a, phase=(a.phase + turn) % 3) for a in first(of))
    for gone in running:
        lost = replace(of, detectors=tuple(d for d in of.detectors if d.id != gone.detector))
        now = {a.detector: a.phase for a in again(lost, running)}
        assert {d: p for d, p in now.items() if d in {a.detector for a in running}} == {
            a.detector: a.phase for a in running if a is not gone
        }
        assert sorted(now.values()) == [0, 1, 2]


@pytest.mark.parametrize(
    ("pattern", "wanted", "per_frame", "kept"),
    [
        ((2, 2), (1, 0), 1, (1, 0)),
        ((2, 2), (1, 1), 1, (1, 0)),
        ((2, 2), (None, 0), 1, (1, 0)),
        ((2, 2), (5, -1), 1, (0, 1)),
        ((2, 4, 4), (1, 0, 2), 1, (1, 0, 2)),
        ((2, 4, 4), (1, 1, 2), 1, (1, 0, 2)),
        ((1, 3), (0, 2), 2, (0, 2)),
        ((3, 3), (0, 1), 1, None),
        ((2, 3), (0, 1), 2, None),
    ],
)
def test_wanted_phases_are_kept_as_far_as_the_rest_can_cover(
    pattern: tuple[int, ...],
    wanted: tuple[int | None, ...],
    per_frame: int,
    kept: tuple[int, ...] | None,
) -> None:
    assert phases_near(pattern, wanted, per_frame) == kept


@pytest.mark.parametrize(
    "change",
    [
        {"detector": "other"},
        {"setup": Setup(threads=3)},
        {"machine": "m3"},
    ],
)
def test_another_detector_of_the_same_name_does_not_go_on(change: dict[str, Any]) -> None:
    of = problem(2, 1, 2, machines=2)
    other = replace(
        of,
        machines=(*of.machines, MachineLimit("m3", "s", math.inf)),
        detectors=(replace(of.detectors[0], **change), of.detectors[1]),
    )
    found = replan(other, first(of), loss=0.5, time_limit_s=10.0)
    assert validate(other, found.plan) == []
    assert (found.kept, found.ended, found.begun) == (1, 1, 1)


def test_another_setup_than_the_problems_is_a_fault() -> None:
    of = problem(1, 1, 1)
    plan = decomposed.solve(of, time_limit_s=10.0)
    wrong = replace(plan, assignments=(replace(plan.assignments[0], setup=Setup(threads=9)),))
    assert any("is not the setup" in fault for fault in validate(of, wrong))


def spoilt(plan: Plan) -> Plan:
    return replace(plan, assignments=tuple(replace(a, phase=a.period) for a in plan.assignments))


def test_an_invalid_plan_made_again_is_replaced_by_a_fresh_one(monkeypatch: pytest.MonkeyPatch) -> None:
    of = problem(2, 1, 2)
    running, honest = first(of), replanning.finished
    monkeypatch.setattr(replanning, "finished", lambda *args: spoilt(honest(*args)))
    found = replan(of, running, loss=0.01, time_limit_s=10.0)
    assert validate(of, found.plan) == []
    assert (found.kept, found.ended, found.begun, found.fewest) == (2, 0, 0, False)


def test_an_invalid_plan_never_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    of = problem(2, 1, 2)
    running, honest = first(of), decomposed.finished
    for module in (replanning, decomposed):
        monkeypatch.setattr(module, "finished", lambda *args: spoilt(honest(*args)))
    with pytest.raises(InvalidPlanError, match=r"phase 2 outside 0 \.\. 1"):
        decomposed.solve(of, time_limit_s=10.0)
    with pytest.raises(InvalidPlanError, match=r"phase 2 outside 0 \.\. 1"):
        replan(of, running, loss=0.01, time_limit_s=10.0)


def test_many_faults_are_counted() -> None:
    of = problem(2, 1, 4)
    plan = decomposed.solve(of, time_limit_s=10.0)
    bad = replace(plan, assignments=tuple(replace(plan.assignments[0], phase=7) for _ in range(5)))
    with pytest.raises(InvalidPlanError, match=r"; and \d+ more"):
        checked(of, bad)
