"""The optimum of an aggregated problem, with proof: columns, an integer master, and what closes the gap.

1. Column generation gives a bound. If it cannot serve every stream, neither can any plan.
2. The integer master over the columns found gives a plan.
3. While plan and bound differ, all configurations within the gap are added and the integer master is solved
   again: nothing better can be missing then, and the answer is the optimum. Where these are too many at once,
   it is done by parts of the gap, each of which may find a better plan and so make the gap narrower.
"""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.allocation.aggregation import Aggregation
from pipeline.allocation.column_generation import Columns, Relaxation, relax
from pipeline.allocation.configuration import Choice, Configuration
from pipeline.allocation.enumeration import add_enumerated
from pipeline.allocation.gap import WHOLE_TOLERANCE, Gap
from pipeline.allocation.integer_master import KEPT_UNITS, IntegerSolution, solve_integer
from pipeline.allocation.linear_master import Goal
from pipeline.allocation.master import Cut, rows_of
from pipeline.allocation.plan import Assignment, Status
from pipeline.allocation.pricing import Pricer, Prices

#: configurations that enumeration may look at before it gives up
MAX_ENUMERATED = 150_000
#: the whole gap is enumerated at once if it has no more
_FEW = 20_000
#: else parts of it, one after the other
_PARTS = (1.0 / 64.0, 1.0 / 16.0, 1.0 / 4.0, 1.0)
#: the ranks that are decided together have prices up to this
_MOST_PRICE = 10_000
#: of the time that is left, column generation may take this much
_LINEAR_SHARE = 0.75


@dataclass(frozen=True, eq=False)
class Found:
    """The answer. columns, solution: None without a plan. bound: in goal units; None if unknown or
    infeasible.
    """

    status: Status
    columns: tuple[Configuration, ...]
    solution: IntegerSolution | None
    bound: int | None


class Search:
    """One aggregated problem; goals can be solved one after the other and share their columns.

    spared: how many streams of each rank go unserved; none, until ``spare`` finds that some must.
    """

    def __init__(self, aggregation: Aggregation, *, deadline_s: float, seed: int = 0) -> None:
        """deadline_s: by time.monotonic()."""
        self.aggregation, self.rows = aggregation, rows_of(aggregation)
        self.columns = Columns(aggregation)
        self._pricer = Pricer(aggregation)
        self._deadline_s, self._until_s, self._seed = deadline_s, deadline_s, seed
        self.spared = (0,) * len(aggregation.streams_of_rank)
        self._last: IntegerSolution | None = None

    def cut(self, cut: Cut) -> None:
        """Exclude what no packing meets; the columns stay."""
        self.rows = rows_of(self.aggregation, [*(known for _, known in self.rows.cuts), cut])
        self._last = None

    def value_goal(self, least_kept: int | None = None) -> Goal:
        """The paper's objective, while at least so many substreams of a running plan go on."""
        return Goal("value", self._dear_prices(), self.spared, least_kept)

    def keep_goal(self, least_value: int) -> Goal:
        """The most substreams that go on, with at least this objective (in OBJECTIVE_RESOLUTION)."""
        return Goal("kept", self._dear_prices(), self.spared, least_value)

    def spare(self, known: tuple[int, ...]) -> bool:
        """Give up as few streams as must be: as few of rank 0 as can be, then as few of rank 1, and so on.

        known: the numbers by rank of some plan, which stand if nothing better is found in time. Returns
        whether what was found is proven.
        """
        self.spared, self._last = known, None
        spared: tuple[int, ...] = ()
        proven = True
        while len(spared) < len(known):
            goal, decided = self._serve_goal(spared), len(spared) + len(self._together(len(spared)))
            if known[: len(spared)] == spared and self._is_least(goal, known[:decided]):
                spared = known[:decided]
                continue
            found = self.solve(goal)
            if found.solution is None:
                return False
            proven = proven and found.status == "optimal"
            spared = found.solution.missing[:decided]
        self.spared = min(spared, known)
        return proven

    def _is_least(self, goal: Goal, known: tuple[int, ...]) -> bool:
        """Whether the linear relaxation tells that no fewer than the known streams can go unserved."""
        relaxation = self._relaxation(goal)
        worth = goal.spared_worth - sum(n * price for n, price in zip(known, goal.prices, strict=False))
        return relaxation is not None and math.floor(relaxation.bound + WHOLE_TOLERANCE) <= worth

    def _serve_goal(self, spared: tuple[int, ...]) -> Goal:
        """Of the next ranks as few unserved as can be; one of a higher rank is dearer than all below it."""
        streams, decided = self.aggregation.streams_of_rank, len(spared)
        prices = [0.0] * len(streams)
        price = 1
        for rank in reversed(self._together(decided)):
            prices[rank] = float(price)
            price *= streams[rank] + 1
        prices[:decided] = [float(price)] * decided
        return Goal("nothing", tuple(prices), spared)

    def _together(self, first: int) -> range:
        """The ranks from ``first`` on that one search can decide."""
        streams, last, price = self.aggregation.streams_of_rank, first, 1
        while last < len(streams) and (last == first or price * (streams[last] + 1) <= _MOST_PRICE):
            price *= streams[last] + 1
            last += 1
        return range(first, last)

    def is_late(self) -> bool:
        """Whether the deadline has come."""
        return time.monotonic() > self._deadline_s

    def know(self, assignments: Sequence[Assignment]) -> None:
        """Add the configurations of a plan that keeps all limits."""
        problem, choices = self.aggregation.problem, defaultdict[str, list[Choice]](list)
        kind_of = {d: k for k, kind in enumerate(self.aggregation.kinds) for d in kind.detectors}
        for a in assignments:
            level = problem.level(a.bitrate_bps, a.codec)
            assert level is not None
            choices[a.stream].append((kind_of[a.detector], level))
        for number, stream_class in enumerate(self.aggregation.classes):
            for stream in stream_class.streams:
                if stream in choices:
                    self.columns.add(number, tuple(sorted(choices[stream])))

    def most_kept(self) -> int:
        """No plan lets more substreams of the running one go on: what each stream alone could keep, in sum."""
        prices = Prices(np.zeros(len(self.aggregation.kinds)), 0.0, 1.0)
        most = 0
        for stream_class in self.aggregation.classes:
            if stream_class.kept.any():
                best = self._pricer.best(stream_class, prices, most=1)
                most += len(stream_class.streams) * round(best[0].profit if best else 0.0)
        return most

    def solve(self, goal: Goal, gap_limit: float = 0.0, share: float = 1.0) -> Found:
        """The best plan for the goal; stops early at a gap (see Plan) of gap_limit.

        share: of the time left until the deadline that may be used.
        """
        now = time.monotonic()
        self._until_s = now + share * (self._deadline_s - now)
        relaxation = self._relaxation(goal)
        if relaxation is None:
            return Found("infeasible", (), None, None)
        gap = Gap(goal, relaxation, gap_limit)
        gap.best = self._carried(goal)
        if not gap.is_closed():
            gap.best = self._integer(gap)
        for part, room in ((1.0, _FEW), *((part, MAX_ENUMERATED) for part in _PARTS)):
            if gap.is_closed() or time.monotonic() > self._until_s:
                break
            width = gap.width(part, self._dear())
            if self._enumerate(relaxation, width, room):
                gap.narrow(self._integer(gap), width)
            elif room == MAX_ENUMERATED:
                break
        if goal.of != "nothing":
            self._last = gap.served() or self._last
        return Found(gap.status(), tuple(self.columns.all), gap.served(), gap.bound)

    def _carried(self, goal: Goal) -> IntegerSolution | None:
        """The last solution, if it is one for this goal too."""
        last = self._last
        if last is None or goal.of == "nothing":
            return None
        worth, other = (last.value, last.kept) if goal.of == "value" else (last.kept * KEPT_UNITS, last.value)
        if goal.floor is not None and other < goal.floor:
            return None
        return replace(last, worth=worth, proven=False)

    def _relaxation(self, goal: Goal) -> Relaxation | None:
        """The relaxation in which all are served but who is spared, or None if there is none."""
        found = self._relax(goal)
        if self._lost(found, goal):
            return None
        if found.unserved <= WHOLE_TOLERANCE or not found.complete:
            return found
        serve = Goal(
            "nothing", (1.0,) * len(goal.spared) + (0.0,) * (len(goal.prices) - len(goal.spared)), goal.spared
        )
        if self._relax(serve).bound < -WHOLE_TOLERANCE:
            return None
        streams = len(self.aggregation.problem.streams)
        return self._relax(replace(goal, prices=tuple(price * streams for price in goal.prices)))

    def _lost(self, found: Relaxation, goal: Goal) -> bool:
        """Whether more streams have no configuration than the goal spares."""
        lost = [0] * len(goal.prices)
        for best, stream_class in zip(found.best, self.aggregation.classes, strict=True):
            lost[stream_class.rank] += len(stream_class.streams) * (best == -math.inf)
        return any(n > spared for n, spared in zip(lost, goal.spared, strict=False))

    def _relax(self, goal: Goal) -> Relaxation:
        now = time.monotonic()
        deadline_s = now + _LINEAR_SHARE * (self._until_s - now)
        return relax(self.aggregation, self.rows, self._pricer, self.columns, goal, deadline_s)

    def _integer(self, gap: Gap) -> IntegerSolution | None:
        found = solve_integer(
            self.aggregation,
            self.rows,
            gap.goal,
            self.columns.all,
            time_limit_s=self._until_s - time.monotonic(),
            seed=self._seed,
            hint=gap.best,
            bound=gap.bound,
            gap_limit=gap.limit,
        )
        if found is None or (gap.best is not None and found.rank() < gap.best.rank()):
            return gap.best
        return found

    def _enumerate(self, relaxation: Relaxation, width: float, room: int) -> bool:
        least = tuple(stake - width for stake in relaxation.stake)
        return add_enumerated(
            self.aggregation,
            self._pricer.states,
            self.columns,
            relaxation.prices,
            least,
            room,
            self._until_s,
        )

    def _dear_prices(self) -> tuple[float, ...]:
        return (self._dear(),) * len(self.spared)

    def _dear(self) -> float:
        """A price of one unserved stream above what any stream can gain, or lose."""
        problem = self.aggregation.problem
        return 2.0 * (problem.detectors_per_frame + len(problem.sites) + problem.detectors_per_stream)
