"""Planning again while the mission runs: at once a valid plan, then the best; partial where it must be.

``first_valid`` mends the running plan in a fraction of a second. ``plan_again`` looks for the best one within
its time limit, and is never worse than what ``first_valid`` finds. Where not all streams can be served it
gives up as few of the greatest priority as can be, of these choices as few of the next, and so on: a stream
is never given up for any number of lower ones. Of the plans that serve as many, those within the loss of the
best one count, and of these that with the fewest changes (see ``replan``).
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence

from pipeline.allocation.aggregation import aggregate
from pipeline.allocation.decomposed import GAP_TOLERANCE, kept_of, still_there
from pipeline.allocation.fewest_changes import Moved, missing, moved
from pipeline.allocation.plan import Assignment, Plan, objective
from pipeline.allocation.planned_again import (
    NO_PRIORITIES,
    PlannedAgain,
    Priorities,
    planned,
    ranks_of,
    served_only,
)
from pipeline.allocation.problem import OBJECTIVE_RESOLUTION, Problem
from pipeline.allocation.repair import repaired, value_bound
from pipeline.allocation.unserved import reason
from pipeline.errors import InvalidPlanError, NoPlanError
from pipeline.logs import Log

_LOG = Log("allocation")
#: of the time limit, what the search may take; the rest is for its last step, the check and the reasons
_SEARCH_SHARE = 0.85


def first_valid(
    problem: Problem,
    running: Sequence[Assignment],
    *,
    priorities: Priorities = NO_PRIORITIES,
    time_limit_s: float = 0.3,
) -> PlannedAgain:
    """A valid plan at once: keeps what can be kept and mends what broke (see ``repair``). Never proven.

    running: the assignments of the plan that runs, of any problem. It serves no stream at all where it finds
    nothing. The same arguments give the same plan, unless the time limit ends it.
    """
    start = time.perf_counter()
    ranks = ranks_of(problem.streams, priorities)
    assignments = _first(problem, running, ranks, time.monotonic() + time_limit_s)
    return _answer(problem, running, assignments, None, start)


def plan_again(
    problem: Problem,
    running: Sequence[Assignment],
    *,
    priorities: Priorities = NO_PRIORITIES,
    loss: float = 0.01,
    time_limit_s: float = 2.0,
    seed: int = 0,
) -> PlannedAgain:
    """The best plan found for a changed problem, for as many streams as can be served, by priority.

    running: the assignments of the plan that runs, of any problem. loss: the share, 0..1, of the best plan's
    accuracy (w * acc_obj) that may be given up to move less. Raises InvalidPlanError if every plan that was
    found breaks a limit.
    """
    start, deadline_s = time.perf_counter(), time.monotonic() + _SEARCH_SHARE * time_limit_s
    ranks, before = ranks_of(problem.streams, priorities), still_there(problem, running)
    first = _first(problem, running, ranks, deadline_s)
    spare = len({a.stream for a in first}) < len(problem.streams)
    try:
        found = moved(
            problem,
            before,
            loss=loss,
            deadline_s=deadline_s,
            seed=seed,
            ranks=ranks,
            known=first,
            spare=spare,
        )
    except (NoPlanError, ValueError) as error:  # too many patterns, or the linear solver gave up
        _LOG.warning("only mended, not planned again", reason=str(error))
        return _answer(problem, running, first, None, start)
    chosen = found.placed
    if chosen is None or _is_better(problem, first, chosen, before, ranks, loss):
        chosen = first
    try:
        return _answer(problem, running, chosen, found, start)
    except InvalidPlanError as error:
        _LOG.warning("a plan made again is not valid, mending the running one", fault=str(error))
        return _answer(problem, running, first, None, start)


def _proven(assignments: Sequence[Assignment], running: Sequence[Assignment], found: Moved) -> bool:
    """Whether nobody more can be served, and nothing more can go on within the loss of the best plan."""
    served = found.spared and missing(found.search.aggregation, assignments) == found.search.spared
    if not served or found.best.status != "optimal":
        return False
    kept = len(kept_of(assignments) & kept_of(running))
    return (found.fewest and assignments is found.placed) or kept >= found.most


def _first(
    problem: Problem, running: Sequence[Assignment], ranks: Mapping[str, int], deadline_s: float
) -> tuple[Assignment, ...]:
    try:
        return repaired(problem, still_there(problem, running), ranks, deadline_s)
    except NoPlanError as error:  # too many patterns
        _LOG.warning("not mended", reason=str(error))
        return ()


def _missing(assignments: Sequence[Assignment], ranks: Mapping[str, int]) -> list[int]:
    """How many streams of each rank are not served."""
    served = {a.stream for a in assignments}
    left_out = [rank for stream, rank in ranks.items() if stream not in served]
    return [left_out.count(rank) for rank in range(max(ranks.values(), default=-1) + 1)]


def _is_better(
    problem: Problem,
    first: tuple[Assignment, ...],
    second: tuple[Assignment, ...],
    running: Sequence[Assignment],
    ranks: Mapping[str, int],
    loss: float,
) -> bool:
    """Whether the first plan serves the priorities better; else is within the loss and keeps more."""
    by_missing = _missing(first, ranks), _missing(second, ranks)
    if by_missing[0] != by_missing[1]:
        return by_missing[0] < by_missing[1]
    values = objective(problem, first), objective(problem, second)
    best, worth = (first, values[0]) if values[0] > values[1] else (second, values[1])
    accuracy = worth + (1.0 - problem.accuracy_weight) * len({(a.stream, a.site) for a in best})
    if min(values) < worth - loss * accuracy - GAP_TOLERANCE:
        return best is first
    kept = [len(kept_of(plan) & kept_of(running)) for plan in (first, second)]
    return kept[0] > kept[1] or (kept[0] == kept[1] and values[0] > values[1] + GAP_TOLERANCE)


def _answer(
    problem: Problem,
    running: Sequence[Assignment],
    assignments: tuple[Assignment, ...],
    found: Moved | None,
    start: float,
) -> PlannedAgain:
    served = served_only(problem, assignments)
    value = objective(problem, assignments)
    bound = max(_bound(problem, assignments, found), value)
    slack = bound - value if bound - value > GAP_TOLERANCE else 0.0
    plan = Plan(
        "feasible" if slack else "optimal",
        value,
        value + slack,
        slack / max(1.0, abs(value)),
        problem.cycle,
        assignments,
        time.perf_counter() - start,
        0 if found is None else len(found.search.columns.all) + len(found.search.rows.supply),
        0 if found is None else len(found.search.aggregation.classes) + len(found.search.rows.limit),
    )
    sure = found is not None and found.spared
    reasons = {
        v: reason(problem, v, assignments, sure=sure) for v in problem.streams if v not in served.streams
    }
    before = still_there(problem, running)
    proven = found is not None and _proven(assignments, before, found)
    return planned(problem, running, plan, reasons, proven=proven)


def _bound(problem: Problem, assignments: Sequence[Assignment], found: Moved | None) -> float:
    """No plan for the same streams has a greater objective."""
    served = served_only(problem, assignments)
    bound = value_bound(aggregate(served), served.streams)
    if found is None or found.best.bound is None:
        return bound
    # what the search gave up has the same number of streams of each rank, and perhaps others
    same = missing(found.search.aggregation, assignments) == found.search.spared
    return min(bound, found.best.bound * OBJECTIVE_RESOLUTION) if same else bound
