"""The search for the fewest changes: within the loss of the best plan, the one that lets most substreams go on.

An answer comes first and then its proof, so that it can be stopped at any time. Streams may go unserved, where
that is asked for: as few of each rank as can be, those of the lower ranks first.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from pipeline.allocation.aggregation import NO_RANKS, Aggregation
from pipeline.allocation.decomposed import kept_of, place
from pipeline.allocation.distinctness import Distinctions, Unpacked, tell_apart
from pipeline.allocation.gap import GAP_UNITS
from pipeline.allocation.integer_master import KEPT_UNITS
from pipeline.allocation.plan import Assignment
from pipeline.allocation.problem import Problem
from pipeline.allocation.proven_optimum import Found, Search

#: a group of machines may be packed this long even if the time limit has come
_PACK_S = 0.1
#: of the time left, the search for the best plan may take so much, and then that for the one that keeps most
_BEST_SHARE, _KEEP_SHARE = 0.6, 0.7
#: gap (see Plan) of a best plan that is near enough for a first answer
_ROUGH_GAP = 0.01


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
    moving = _Moving(problem, running, loss, known, deadline_s, seed, ranks)
    while True:
        found = moving.round(spare=spare)
        if found is not None:
            return found


class _Moving:
    """One search for the fewest changes. Every round ends with the answer, or with something told apart."""

    def __init__(
        self,
        problem: Problem,
        running: Sequence[Assignment],
        loss: float,
        known: Sequence[Assignment],
        deadline_s: float,
        seed: int,
        ranks: Mapping[str, int],
    ) -> None:
        self._problem, self._running, self._loss, self._known = problem, running, loss, known
        self._deadline_s, self._seed, self._ranks = deadline_s, seed, ranks
        self._kept, self._told = kept_of(running), Distinctions()
        self._search = self._begun()
        self._most = self._search.most_kept()
        self._answer: Moved | None = None
        self._spared = True

    def round(self, *, spare: bool) -> Moved | None:
        """The answer, or None if the search must go on."""
        search = self._search
        if spare:
            self._spared = search.spare(missing(search.aggregation, self._known))
        best = search.solve(search.value_goal(), _ROUGH_GAP, share=_BEST_SHARE)
        if best.status == "feasible":  # good enough for an answer, before the time is spent on the proof
            self._take(best, _fewest(search, best, self._loss)[0])
            if self._answer is not None and search.is_late():
                return self._answer
            best = search.solve(search.value_goal(), share=_BEST_SHARE)
        if best.solution is None:
            return self._answer or self._without(best)
        if self._proves(best):
            return self._answer
        if search.is_late():
            return self._answer or self._without(replace(best, status="unknown"))
        return None

    def _proves(self, best: Found) -> bool:
        """Take the plan with the fewest changes; whether it is the answer. If not, tell something apart."""
        search, told = self._search, self._told
        chosen, fewest, bound = _fewest(search, best, self._loss)
        packed = self._pack(best, ())  # only what can be packed is what the loss refers to
        if bound is not None and not isinstance(packed, Unpacked):
            self._most = min(self._most, bound)
        placed = self._take(best, chosen, fewest=fewest, attained=not isinstance(packed, Unpacked))
        unpacked = next((one for one in (placed, packed) if isinstance(one, Unpacked)), None)
        if self._answer is not None and self._answer.fewest:
            return True
        if unpacked is not None:
            self._told = tell_apart(search, unpacked, told)
        elif not isinstance(placed, Unpacked):
            displaced = _displaced(search.aggregation, placed, self._running)
            if not displaced:
                return True
            self._told = Distinctions(told.machines | displaced, told.streams)
        if self._told != told and not search.is_late():
            self._search = self._begun()
        return False

    def _take(
        self, best: Found, chosen: Found, *, fewest: bool = False, attained: bool = False
    ) -> tuple[Assignment, ...] | Unpacked:
        """Make a solution the answer, if it can be packed and keeps no less than the one so far."""
        placed = self._pack(chosen, self._running)
        if isinstance(placed, Unpacked):
            return placed
        go_on = len(kept_of(placed) & self._kept)
        all_that_can = go_on >= self._most
        displaced = _displaced(self._search.aggregation, placed, self._running)
        proven = fewest and (all_that_can or (attained and not displaced))
        found = Moved(best, placed, proven, self._most, self._spared, self._search)
        before = self._answer
        if before is None or proven or go_on >= len(kept_of(before.placed or ()) & self._kept):
            self._answer = found
        else:
            self._answer = replace(before, most=self._most)
        return placed

    def _pack(self, found: Found, running: Sequence[Assignment]) -> tuple[Assignment, ...] | Unpacked:
        search = self._search
        return place(
            search.aggregation, search.rows, found, running, deadline_s=self._deadline_s, least_s=_PACK_S
        )

    def _begun(self) -> Search:
        search = self._told.search(
            self._problem, self._kept, deadline_s=self._deadline_s, seed=self._seed, ranks=self._ranks
        )
        search.know(self._known)
        return search

    def _without(self, best: Found) -> Moved:
        return Moved(best, None, False, self._most, self._spared, self._search)


def missing(aggregation: Aggregation, known: Sequence[Assignment]) -> tuple[int, ...]:
    """How many streams of each rank are assigned nothing."""
    served = {a.stream for a in known}
    counts = [0] * len(aggregation.streams_of_rank)
    for stream_class in aggregation.classes:
        counts[stream_class.rank] += sum(stream not in served for stream in stream_class.streams)
    return tuple(counts)


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
    if search.is_late():
        return best, False, None
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
