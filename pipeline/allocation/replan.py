"""Planning again while a plan runs: as good as stated, with the fewest changes.

A substream *goes on* if the new plan has the same stream on the same detector at the same bitrate and codec;
its encoder, its channel and its detector then need not notice (its phase may shift, which only the source
sees). Everything else is moved: ended, or begun anew. Among the plans that lose at most the stated share of
accuracy, that with the fewest ended substreams is taken, and of these the best.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from pipeline.allocation.aggregation import NO_RANKS, Aggregation, Kept
from pipeline.allocation.checked import checked
from pipeline.allocation.decomposed import finished, kept_of, place, solve, still_there, without_plan
from pipeline.allocation.distinctness import Distinctions, Unpacked, tell_apart
from pipeline.allocation.integer_master import KEPT_UNITS
from pipeline.allocation.plan import Assignment, Plan
from pipeline.allocation.problem import OBJECTIVE_RESOLUTION, Problem
from pipeline.allocation.proven_optimum import GAP_UNITS, Found, Search
from pipeline.errors import InvalidPlanError
from pipeline.logs import Log

_LOG = Log("allocation")
#: a fresh plan after an invalid one may take this long, even if the time limit has come
_LEAST_TIME_S = 1.0
#: a group of machines may be packed this long even if the time limit has come
_PACK_S = 0.1
#: of the time left, the search for the best plan may take so much, and then that for the one that keeps most
_BEST_SHARE, _KEEP_SHARE = 0.6, 0.7


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
    plan, fewest = (
        finished(problem, best, found.placed, time.perf_counter() - start, found.search),
        found.fewest,
    )
    try:
        checked(problem, plan)
    except InvalidPlanError as error:
        _LOG.warning("a plan made again is not valid, solving afresh", fault=str(error))
        left_s = max(deadline_s - time.monotonic(), _LEAST_TIME_S)
        plan, fewest = solve(problem, time_limit_s=left_s, seed=seed), False
    kept = len(kept_of(plan.assignments) & kept_of(before))
    best_objective = best.solution.value * OBJECTIVE_RESOLUTION
    return Replanned(plan, best_objective, kept, len(running) - kept, len(plan.assignments) - kept, fewest)


@dataclass(frozen=True, eq=False)
class Moved:
    """What a search with the fewest changes found. best: of the best plan, however much it moves. placed: None
    without a plan. fewest: see Replanned. most: no plan within the loss lets more substreams go on. spared:
    whether it is proven that no more streams can be served.
    """

    best: Found
    placed: tuple[Assignment, ...] | None
    fewest: bool
    most: int
    spared: bool
    search: Search


def moved(
    problem: Problem,
    running: Sequence[Assignment],
    *,
    loss: float,
    deadline_s: float,
    seed: int = 0,
    ranks: Mapping[str, int] = NO_RANKS,
    known: Sequence[Assignment] = (),
    spare: bool = False,
) -> Moved:
    """The fewest changes within the loss. running: of ``still_there``. known: a plan that keeps all limits.

    spare: streams may go unserved, as few of each rank as can be, those of the lower ranks first.
    """
    kept = kept_of(running)
    told = Distinctions()

    def begun() -> Search:
        search = told.search(problem, kept, deadline_s=deadline_s, seed=seed, ranks=ranks)
        search.know(known)
        return search

    search = begun()
    answer: Moved | None = None
    most = search.most_kept()
    while True:
        spared = search.spare(missing(search.aggregation, known)) if spare else True
        best = search.solve(search.value_goal(), share=_BEST_SHARE)
        if best.solution is None:
            return answer or Moved(best, None, False, most, spared, search)
        # the answer first, and then the proof: that the best plan can be packed, which the loss refers to
        chosen, fewest, bound = _fewest(search, best, loss)
        placed = place(
            search.aggregation, search.rows, chosen, running, deadline_s=deadline_s, least_s=_PACK_S
        )
        packed = place(search.aggregation, search.rows, best, deadline_s=deadline_s, least_s=_PACK_S)
        attained = not isinstance(packed, Unpacked)
        displaced = frozenset[str]()
        if attained and bound is not None:
            most = min(most, bound)
        if not isinstance(placed, Unpacked):
            displaced = _displaced(search.aggregation, placed, running)
            most_go_on = len(kept_of(placed) & kept) >= most
            proven = fewest and (most_go_on or (attained and not displaced))
            found = Moved(best, placed, proven, most, spared, search)
            if answer is None or proven or _kept(found, kept) >= _kept(answer, kept):
                answer = found
            answer = replace(answer, most=most)
            if proven or (attained and not displaced):
                return answer
        if time.monotonic() > deadline_s:
            return answer or Moved(replace(best, status="unknown"), None, False, most, spared, search)
        before = told
        unpacked = next((one for one in (placed, packed) if isinstance(one, Unpacked)), None)
        if unpacked is not None:
            told = tell_apart(search, unpacked, told)
        else:
            told = Distinctions(told.machines | displaced, told.streams)
        if told != before:
            search = begun()


def missing(aggregation: Aggregation, known: Sequence[Assignment]) -> tuple[int, ...]:
    """How many streams of each rank are assigned nothing."""
    served = {a.stream for a in known}
    counts = [0] * len(aggregation.streams_of_rank)
    for stream_class in aggregation.classes:
        counts[stream_class.rank] += sum(stream not in served for stream in stream_class.streams)
    return tuple(counts)


def _kept(found: Moved, kept: Kept) -> int:
    return len(kept_of(found.placed or ()) & kept)


def _fewest(search: Search, best: Found, loss: float) -> tuple[Found, bool, int | None]:
    """The best solution of those that end fewest substreams, whether both are proven, and the most that can
    go on (as far as kinds tell: packing may allow fewer).
    """
    assert best.solution is not None
    accuracy = sum(
        count * int(search.aggregation.classes[column.stream_class].value[choice])
        for count, column in zip(best.solution.counts, best.columns, strict=False)
        for choice in column.choices
    )
    least = best.solution.value - max(math.floor(loss * accuracy), GAP_UNITS)
    keeping = search.solve(search.keep_goal(least), share=_KEEP_SHARE)
    most = None if keeping.bound is None else keeping.bound // KEPT_UNITS
    if keeping.solution is None or keeping.status != "optimal":
        return (best if keeping.solution is None else keeping), False, most
    finest = search.solve(search.value_goal(keeping.solution.kept))
    if finest.solution is None:
        return keeping, False, most
    return finest, finest.status == "optimal" and best.status == "optimal", most


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
