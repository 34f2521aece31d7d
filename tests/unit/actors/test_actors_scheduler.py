"""The scheduler hosts the controller: a new one that plays the log of the one before goes on where that was."""

from __future__ import annotations

import time
from types import SimpleNamespace

import numpy as np

from actors.live_record import LiveRecord
from actors.scheduler import SchedulerActor
from pipeline.allocation.plan import Plan
from pipeline.allocation.problem import Problem
from pipeline.mission.controller.events import Gone, MachineReport, NotSolved, ReducerReport, SourceReport
from pipeline.mission.controller.orders import Run, Solve
from pipeline.mission.controller.state import begin
from tests.rehearsals import draw_problem, quick_plan


def prepared(problem: Problem, **priorities: int) -> SimpleNamespace:
    streams = [SimpleNamespace(id=v, priority=priorities.get(v, 0)) for v in problem.streams]
    return SimpleNamespace(problem=problem, mission=SimpleNamespace(streams=streams))


def _scheduler():
    problem = draw_problem(np.random.default_rng(4))
    solved = quick_plan(Solve(1, problem, ()))[-1]
    plan = Plan("optimal", 0.0, 0.0, 0.0, problem.cycle, solved.assignments, 0.0, 0, 0)
    scheduler = SchedulerActor(prepared(problem))
    scheduler.begin(plan, begin(problem, 0.0), ())
    return scheduler, problem, plan


def _all_up(problem):
    return [
        *(MachineReport(m.id, 0) for m in problem.machines),
        *(SourceReport(v, 0, -1) for v in problem.streams),
        ReducerReport(0),
    ]


def _heard(scheduler, events, now_s):
    return list(scheduler.hear(events, now_s).recorded)


def _until(scheduler, log, kind, now_s):
    """Hear nothing until an order of a kind comes: the solver works in a thread."""
    for _ in range(400):
        log += _heard(scheduler, (), now_s)
        found = [o for r in log for o in r.orders if isinstance(o, kind)]
        if found:
            return found
        time.sleep(0.05)
    raise AssertionError(f"no {kind.__name__}")


def test_the_first_plan_is_the_one_that_was_made_for_the_whole_inventory() -> None:
    scheduler, problem, plan = _scheduler()
    log = _heard(scheduler, _all_up(problem), 0.1)
    _until(scheduler, log, Run, 0.2)
    time.sleep(0.2)
    log += _heard(scheduler, (), 0.3)
    held = {
        o.assignment for r in log for order in r.orders if isinstance(order, Run) for o in order.substreams
    }
    assert held == set(plan.assignments)


def test_a_new_scheduler_orders_what_the_one_before_would_have_ordered() -> None:
    scheduler, problem, plan = _scheduler()
    log = _heard(scheduler, _all_up(problem), 0.1)
    _until(scheduler, log, Run, 0.2)
    again, _, _ = _scheduler()
    again.begin(plan, begin(problem, 0.0), log)
    assert again._state == scheduler._state


def test_a_state_is_given_now_and_then_and_a_new_scheduler_goes_on_from_it_with_a_short_log() -> None:
    scheduler, problem, plan = _scheduler()
    record = LiveRecord(0.0, begin(problem, 0.0), SimpleNamespace(append=len), None, None)
    longest = 0
    for k in range(700):
        record.take(scheduler.hear(_all_up(problem), 0.1 + 0.25 * k))
        longest = max(longest, len(record.log))
    assert 400 < longest < 700  # of more than 700 * 5 events
    again, _, _ = _scheduler()
    again.begin(plan, record.state, tuple(record.log))
    assert again._state == scheduler._state


def test_a_question_whose_answer_died_with_the_scheduler_is_asked_again() -> None:
    scheduler, problem, plan = _scheduler()
    log = _heard(scheduler, _all_up(problem), 0.1)
    asked = [o for r in log for o in r.orders if isinstance(o, Solve)]
    assert len(asked) == 1
    again, _, _ = _scheduler()
    again.begin(plan, begin(problem, 0.0), log)
    log = _heard(again, (), 0.2)
    assert any(isinstance(r.event, NotSolved) for r in log)
    log = _heard(again, [Gone("nobody", 0, "")], 2.0)
    assert [o.request for r in log for o in r.orders if isinstance(o, Solve)] == [2]


def test_the_solver_is_told_the_priorities_of_the_mission_file(monkeypatch) -> None:
    told = []
    monkeypatch.setattr(
        "actors.scheduler.answers", lambda question, **how: told.append(how["priorities"]) or ()
    )
    problem = draw_problem(np.random.default_rng(4))
    SchedulerActor(prepared(problem, v1=7))._solve(Solve(2, problem, ()))
    assert told == [{v: 7 if v == "v1" else 0 for v in problem.streams}]
