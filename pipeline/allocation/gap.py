"""The gap between the best solution so far and what none can exceed."""

from __future__ import annotations

import math

from pipeline.allocation.column_generation import Relaxation
from pipeline.allocation.integer_master import KEPT_UNITS, IntegerSolution
from pipeline.allocation.linear_master import Goal
from pipeline.allocation.plan import Status
from pipeline.allocation.problem import OBJECTIVE_RESOLUTION

#: goal units (1e-9 of objective) by which a plan may miss its bound and count as optimal: the linear solver's
#: own tolerance
GAP_UNITS = 100
#: an amount of streams or substreams that is none
WHOLE_TOLERANCE = 1e-6


class Gap:
    """Between the best plan so far and what no plan can exceed, in goal units."""

    def __init__(self, goal: Goal, relaxation: Relaxation, limit: float) -> None:
        self.goal, self.limit = goal, limit
        self.best: IntegerSolution | None = None
        self._unit = OBJECTIVE_RESOLUTION if goal.of == "value" else 1.0 / KEPT_UNITS
        self._root = math.floor(relaxation.bound / self._unit + 0.5)
        if goal.of != "value":  # substreams and streams are whole
            self._root = math.floor(relaxation.bound + WHOLE_TOLERANCE) * KEPT_UNITS
        self.bound = self._root
        self._exhausted = False

    def served(self) -> IntegerSolution | None:
        """The best solution that serves every stream but those that the goal spares."""
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
