"""Planning again while a plan runs: as good as stated, with the fewest changes.

A substream *goes on* if the new plan has the same stream on the same detector at the same bitrate and codec;
its encoder, its channel and its detector then need not notice (its phase may shift, which only the source
sees). Everything else is moved: ended, or begun anew. Among the plans that lose at most the stated share of
accuracy, that with the fewest ended substreams is taken, and of these the best.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.allocation.aggregation import Aggregation
from pipeline.allocation.checked import checked
from pipeline.allocation.decomposed import finished, kept_of, place, solve, still_there, without_plan
from pipeline.allocation.distinctness import Distinctions, Unpacked, tell_apart
from pipeline.allocation.plan import Assignment, Plan
from pipeline.allocation.problem import OBJECTIVE_RESOLUTION, Problem
from pipeline.allocation.proven_optimum import GAP_UNITS, Found, Search
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
    start = time.monotonic()
    found = _replan(problem, running, loss, start + time_limit_s, seed)
    try:
        checked(problem, found.plan)
    except InvalidPlanError as error:
        _LOG.warning("plan made again is not valid, solving afresh", fault=str(error))
        left_s = start + time_limit_s - time.monotonic()
        fresh = solve(problem, time_limit_s=max(left_s, _LEAST_TIME_S), seed=seed)
        kept = len(kept_of(fresh.assignments) & kept_of(still_there(problem, running)))
        ended, begun = len(running) - kept, len(fresh.assignments) - kept
        return Replanned(fresh, fresh.objective, kept, ended, begun, fewest=False)
    return found


def _replan(
    problem: Problem, running: Sequence[Assignment], loss: float, deadline_s: float, seed: int
) -> Replanned:
    start = time.perf_counter()
    before = still_there(problem, running)
    known, kept = Distinctions(), kept_of(before)
    search = known.search(problem, kept, deadline_s=deadline_s, seed=seed)
    answer: Replanned | None = None
    while True:
        best = search.solve(search.value_goal())
        if best.solution is None:
            plan = without_plan(problem, best.status, time.perf_counter() - start, search)
            return answer or Replanned(plan, None, 0, len(running), 0, fewest=False)
        told, proven = known, False
        placed = place(search.aggregation, search.rows, best, deadline_s=deadline_s)
        if not isinstance(placed, Unpacked):
            chosen, proven = _fewest(search, best, loss)
            placed = place(search.aggregation, search.rows, chosen, before, deadline_s=deadline_s)
        if isinstance(placed, Unpacked):
            known = tell_apart(search, placed, known)
        else:
            displaced = _displaced(search.aggregation, placed, before)
            plan = finished(problem, best, placed, time.perf_counter() - start, search)
            on = len(kept_of(placed) & kept)
            found = Replanned(
                plan,
                best.solution.value * OBJECTIVE_RESOLUTION,
                on,
                len(running) - on,
                len(placed) - on,
                proven and not displaced,
            )
            answer = found if answer is None or found.kept >= answer.kept else answer
            if not displaced or time.monotonic() > deadline_s:
                return answer
            known = Distinctions(known.machines | displaced, known.streams)
        if known != told:
            search = known.search(problem, kept, deadline_s=deadline_s, seed=seed)


def _fewest(search: Search, best: Found, loss: float) -> tuple[Found, bool]:
    """The best solution of those that end fewest substreams, and whether both are proven."""
    assert best.solution is not None
    accuracy = sum(
        count * int(search.aggregation.classes[column.stream_class].value[choice])
        for count, column in zip(best.solution.counts, best.columns, strict=False)
        for choice in column.choices
    )
    least = best.solution.value - max(math.floor(loss * accuracy), GAP_UNITS)
    keeping = search.solve(search.keep_goal(least))
    if keeping.solution is None or keeping.status != "optimal":
        return (best if keeping.solution is None else keeping), False
    finest = search.solve(search.value_goal(keeping.solution.kept))
    if finest.solution is None:
        return keeping, False
    return finest, finest.status == "optimal" and best.status == "optimal"


def _displaced(
    aggregation: Aggregation, placed: Sequence[Assignment], running: Sequence[Assignment]
) -> frozenset[str]:
    """Machines of the groups in which a substream moved to another machine of its group."""
    group_of = {machine: group.machines for group in aggregation.groups for machine in group.machines}
    now, before = kept_of(placed), kept_of(running)
    like = {
        (a.stream, a.pool_detector, a.bitrate_bps, a.codec, group_of[a.machine])
        for a in placed
        if (a.stream, a.detector, a.bitrate_bps, a.codec) not in before
    }
    return frozenset(
        machine
        for a in running
        if (a.stream, a.detector, a.bitrate_bps, a.codec) not in now and a.machine in group_of
        if (a.stream, a.pool_detector, a.bitrate_bps, a.codec, group_of[a.machine]) in like
        for machine in group_of[a.machine]
    )
