"""The optimum of an aggregated problem, with proof: columns, an integer master, and what closes the gap.

1. Column generation gives a bound. If it cannot serve every stream, neither can any plan.
2. The integer master over the columns found gives a plan.
3. While plan and bound differ, all configurations within a part of the gap are added and the integer master
   is
   solved again. Once that part is the whole gap nothing better can be missing: the answer is the optimum.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

from pipeline.allocation.aggregation import Aggregation
from pipeline.allocation.column_generation import Columns, Relaxation, relax
from pipeline.allocation.configuration import Configuration
from pipeline.allocation.enumeration import add_enumerated
from pipeline.allocation.integer_master import KEPT_UNITS, IntegerSolution, solve_integer
from pipeline.allocation.linear_master import Goal
from pipeline.allocation.master import Cut, rows_of
from pipeline.allocation.plan import Status
from pipeline.allocation.pricing import Pricer
from pipeline.allocation.problem import OBJECTIVE_RESOLUTION

#: goal units (1e-9 of objective) by which a plan may miss its bound and count as optimal: the linear solver's
#: own tolerance
GAP_UNITS = 100
#: configurations that enumeration may look at before it gives up
MAX_ENUMERATED = 150_000
#: parts of the gap that are enumerated, one after the other
_PARTS = (1.0 / 64.0, 1.0 / 16.0, 1.0 / 4.0, 1.0)
_SERVE = Goal("nothing", 1.0)
_UNSERVED_TOLERANCE = 1e-6
#: of the time that is left, column generation may take this much
_LINEAR_SHARE = 0.6


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
    """One aggregated problem; goals can be solved one after the other and share their columns."""

    def __init__(self, aggregation: Aggregation, *, deadline_s: float, seed: int = 0) -> None:
        """deadline_s: by time.monotonic()."""
        self.aggregation, self.rows = aggregation, rows_of(aggregation)
        self.columns = Columns(aggregation)
        self._pricer = Pricer(aggregation)
        self._deadline_s, self._seed = deadline_s, seed

    def cut(self, cut: Cut) -> None:
        """Exclude what no packing meets; the columns stay."""
        self.rows = rows_of(self.aggregation, [*(known for _, known in self.rows.cuts), cut])

    def value_goal(self, least_kept: int | None = None) -> Goal:
        """The paper's objective, while at least so many substreams of a running plan go on."""
        return Goal("value", self._dear(), least_kept)

    def keep_goal(self, least_value: int) -> Goal:
        """The most substreams that go on, with at least this objective (in OBJECTIVE_RESOLUTION)."""
        return Goal("kept", self._dear(), least_value)

    def solve(self, goal: Goal, gap_limit: float = 0.0) -> Found:
        """The best plan for the goal; stops early at a gap (see Plan) of gap_limit."""
        relaxation = self._relaxation(goal)
        if relaxation is None:
            return Found("infeasible", (), None, None)
        gap = _Gap(goal, relaxation, gap_limit)
        gap.best = self._integer(gap)
        for part in _PARTS:
            if gap.is_closed() or time.monotonic() > self._deadline_s:
                break
            width = gap.width(part, self._dear())
            if not self._enumerate(relaxation, width):
                break
            gap.narrow(self._integer(gap), width)
        return Found(gap.status(), tuple(self.columns.all), gap.served(), gap.bound)

    def _relaxation(self, goal: Goal) -> Relaxation | None:
        """The relaxation in which every stream is served, or None if there is none."""
        found = self._relax(goal)
        if -math.inf in found.best:
            return None
        if found.unserved <= _UNSERVED_TOLERANCE or not found.complete:
            return found
        if self._relax(_SERVE).bound < -_UNSERVED_TOLERANCE:
            return None
        return self._relax(replace(goal, unserved=goal.unserved * len(self.aggregation.problem.streams)))

    def _relax(self, goal: Goal) -> Relaxation:
        now = time.monotonic()
        deadline_s = now + _LINEAR_SHARE * (self._deadline_s - now)
        return relax(self.aggregation, self.rows, self._pricer, self.columns, goal, deadline_s)

    def _integer(self, gap: _Gap) -> IntegerSolution | None:
        found = solve_integer(
            self.aggregation,
            self.rows,
            gap.goal,
            self.columns.all,
            time_limit_s=self._deadline_s - time.monotonic(),
            seed=self._seed,
            hint=gap.best,
            bound=gap.bound,
            gap_limit=gap.limit,
        )
        if found is None or (gap.best is not None and found.rank() < gap.best.rank()):
            return gap.best
        return found

    def _enumerate(self, relaxation: Relaxation, width: float) -> bool:
        least = tuple(best - width for best in relaxation.best)
        return add_enumerated(
            self.aggregation, self._pricer.states, self.columns, relaxation.prices, least, MAX_ENUMERATED
        )

    def _dear(self) -> float:
        """A price of one unserved stream above what any stream can gain, or lose."""
        problem = self.aggregation.problem
        return 2.0 * (problem.detectors_per_frame + len(problem.sites) + problem.detectors_per_stream)


class _Gap:
    """Between the best plan so far and what no plan can exceed, in goal units."""

    def __init__(self, goal: Goal, relaxation: Relaxation, limit: float) -> None:
        self.goal, self.limit = goal, limit
        self.best: IntegerSolution | None = None
        self._unit = OBJECTIVE_RESOLUTION if goal.of == "value" else 1.0 / KEPT_UNITS
        self._root = math.floor(relaxation.bound / self._unit + 0.5)
        if goal.of == "kept":  # substreams are whole
            self._root = math.floor(relaxation.bound + _UNSERVED_TOLERANCE) * KEPT_UNITS
        self.bound = self._root
        self._exhausted = False

    def served(self) -> IntegerSolution | None:
        """The best solution that serves every stream."""
        return self.best if self.best is not None and self.best.unserved == 0 else None

    def is_closed(self) -> bool:
        """Whether the best plan is near enough to the bound."""
        best = self.served()
        if best is None:
            return False
        near_enough = self.limit * max(1.0 / self._unit, abs(best.worth))
        return self.bound - best.worth <= max(float(GAP_UNITS), near_enough)

    def width(self, part: float, dear: float) -> float:
        """How far below its class's best a configuration may be and still be added; of the goal."""
        best = self.served()
        if best is None:
            return math.inf if part >= 1.0 else part * dear
        return (part * (self._root - best.worth) + GAP_UNITS) * self._unit

    def narrow(self, solution: IntegerSolution | None, width: float) -> None:
        """Take the optimum over all configurations within the width."""
        self.best = solution
        if solution is None or not solution.proven:
            return
        self._exhausted = math.isinf(width)
        missing = solution.worth if self._exhausted else self._root - math.floor(width / self._unit)
        if solution.unserved == 0:
            self.bound = min(self.bound, max(solution.worth, missing))

    def status(self) -> Status:
        """What is known of the best plan."""
        best = self.served()
        if best is None:
            return "infeasible" if self._exhausted else "unknown"
        self.bound = max(self.bound, best.worth)
        return "optimal" if self.bound - best.worth <= GAP_UNITS else "feasible"
