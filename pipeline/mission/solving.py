"""The answers to a question of the mission controller: a valid plan at once, then the best."""

from __future__ import annotations

from collections.abc import Iterator

from pipeline.allocation.again import first_valid, plan_again
from pipeline.allocation.planned_again import PlannedAgain, Priorities
from pipeline.mission.controller.events import Solved, Unserved
from pipeline.mission.controller.orders import Solve


def answers(
    question: Solve, *, priorities: Priorities, loss: float, first_s: float = 0.3, time_limit_s: float = 2.0
) -> Iterator[Solved]:
    """The plan that mends the running one, within first_s, and the best one found, within time_limit_s after it.

    priorities: of the streams, see ``plan_again``. loss: share of accuracy that may be given up to move less.
    """
    running = question.running
    mended = first_valid(question.problem, running, priorities=priorities, time_limit_s=first_s)
    yield _solved(question.request, mended, final=False)
    best = plan_again(question.problem, running, priorities=priorities, loss=loss, time_limit_s=time_limit_s)
    yield _solved(question.request, best, final=True)


def _solved(request: int, answer: PlannedAgain, *, final: bool) -> Solved:
    unserved = tuple(Unserved(one.stream, one.reason) for one in answer.unserved)
    return Solved(request, answer.plan.assignments, unserved, final)
