"""Planning again while a plan runs: as good as stated, with the fewest changes.

A substream *goes on* if the new plan has the same stream on the same detector at the same bitrate and codec;
its encoder, its channel and its detector then need not notice (its phase may shift, which only the source
sees). Everything else is moved: ended, or begun anew. Among the plans that lose at most the stated share of
accuracy, that with the fewest ended substreams is taken, and of these the best.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.allocation.checked import checked
from pipeline.allocation.decomposed import finished, kept_of, solve, still_there, without_plan
from pipeline.allocation.fewest_changes import moved
from pipeline.allocation.plan import Assignment, Plan
from pipeline.allocation.problem import OBJECTIVE_RESOLUTION, Problem
from pipeline.errors import InvalidPlanError
from pipeline.logs import Log

_LOG = Log("allocation")
#: a fresh plan after an invalid one may take this long, even if the time limit has come
_LEAST_TIME_S = 1.0


@dataclass(frozen=True)
class Replanned:
    """The new plan, and what changes. The plan's bound and gap are to the best plan, however much it moves.

    best_objective: of the best plan, however much it moves; None without a plan. kept, ended, begun: numbers
    of substreams. fewest: whether it is proven that no plan within the loss ends fewer.
    """

    plan: Plan
    best_objective: float | None
    kept: int
    ended: int
    begun: int
    fewest: bool


def replan(
    problem: Problem, running: Sequence[Assignment], *, loss: float, time_limit_s: float, seed: int = 0
) -> Replanned:
    """The plan for a changed problem. running: the assignments of the plan that runs, of any problem.

    loss: the share, 0..1, of the best plan's accuracy (w * acc_obj) that may be given up to move less. A plan
    that breaks a limit is not handed out: a fresh one takes its place. Raises as ``decomposed.solve``.
    """
    start, before = time.perf_counter(), still_there(problem, running)
    deadline_s = time.monotonic() + time_limit_s
    found = moved(problem, before, loss=loss, deadline_s=deadline_s, seed=seed)
    best = found.best
    if found.placed is None or best.solution is None:
        plan = without_plan(problem, best.status, time.perf_counter() - start, found.search)
        return Replanned(plan, None, 0, len(running), 0, fewest=False)
    plan = finished(problem, best, found.placed, time.perf_counter() - start, found.search)
    fewest = found.fewest
    try:
        checked(problem, plan)
    except InvalidPlanError as error:
        _LOG.warning("a plan made again is not valid, solving afresh", fault=str(error))
        left_s = max(deadline_s - time.monotonic(), _LEAST_TIME_S)
        plan, fewest = solve(problem, time_limit_s=left_s, seed=seed), False
    kept = len(kept_of(plan.assignments) & kept_of(before))
    best_objective = best.solution.value * OBJECTIVE_RESOLUTION
    return Replanned(plan, best_objective, kept, len(running) - kept, len(plan.assignments) - kept, fewest)
