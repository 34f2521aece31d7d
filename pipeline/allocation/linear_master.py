"""The linear relaxation of the master problem, in GLOP; configurations are added as they are priced."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from ortools.linear_solver import pywraplp

from pipeline.allocation.aggregation import Aggregation
from pipeline.allocation.configuration import Configuration
from pipeline.allocation.master import Rows
from pipeline.allocation.problem import OBJECTIVE_RESOLUTION
from pipeline.messages import FloatArray


@dataclass(frozen=True)
class Goal:
    """What is maximised, less the price of each stream that goes unserved.

    of: the objective, the substreams of a running plan that go on, or nothing but the streams served. prices:
    of a stream unserved, by rank. spared: by rank, so many streams go unserved, no fewer, and at no price; of
    the ranks that it does not list any number may. floor: the least of the other one, objective in
    OBJECTIVE_RESOLUTION or substreams; None for any.
    """

    of: Literal["value", "kept", "nothing"]
    prices: tuple[float, ...]
    spared: tuple[int, ...]
    floor: int | None = None

    def worth(self, column: Configuration) -> float:
        """What one stream in a configuration adds."""
        if self.of == "nothing":
            return 0.0
        return column.value * OBJECTIVE_RESOLUTION if self.of == "value" else float(column.kept)

    def floored(self, column: Configuration) -> float:
        """What one stream in a configuration adds to what has a floor."""
        return float(column.kept) if self.of == "value" else column.value * OBJECTIVE_RESOLUTION

    @property
    def spared_worth(self) -> float:
        """What the streams that go unserved at no price would have cost."""
        return sum(n * price for n, price in zip(self.spared, self.prices, strict=False))

    @property
    def floor_worth(self) -> float:
        """The floor in the unit of ``floored``."""
        return (self.floor or 0) * (1.0 if self.of == "value" else OBJECTIVE_RESOLUTION)


@dataclass(frozen=True, eq=False)
class LinearSolution:
    """worth: the greatest. served: float64 (classes,), what serving one more stream would add. prices: float64
    (ranks,), of one more stream unserved, less what it is worth that so many must be. duals: float64 (rows,),
    of the group rows, at least 0. floor_dual: of the floor, at least 0. unserved: streams without a
    configuration, of the ranks with a number that are spared, beyond that number; in sum.
    """

    worth: float
    served: FloatArray
    prices: FloatArray
    duals: FloatArray
    floor_dual: float
    unserved: float


class LinearMaster:
    """Columns come in, prices come out."""

    def __init__(self, aggregation: Aggregation, rows: Rows, goal: Goal) -> None:
        self._goal, self._rows = goal, rows
        self._solver = pywraplp.Solver.CreateSolver("GLOP")
        infinity = self._solver.infinity()
        self._serve = [self._solver.Constraint(len(c.streams), len(c.streams)) for c in aggregation.classes]
        # rows are scaled so that their entries are about 1: memory in kilobytes would spoil the tolerances
        self._scale = _scale(rows)
        self._limits = [
            self._solver.Constraint(-infinity, limit / scale)
            for limit, scale in zip(rows.limit.tolist(), self._scale.tolist(), strict=True)
        ]
        self._floor = None
        if goal.floor is not None:
            self._floor = self._solver.Constraint(goal.floor_worth, infinity)
        self._solver.Objective().SetMaximization()
        self._ranks = [c.rank for c in aggregation.classes]
        self._spared = [self._solver.Constraint(float(n), infinity) for n in goal.spared]
        self._unserved = [
            self._column(
                {serve: 1.0} | ({self._spared[rank]: 1.0} if rank < len(self._spared) else {}),
                -goal.prices[rank],
            )
            for serve, rank in zip(self._serve, self._ranks, strict=True)
        ]
        for entries in rows.supply:
            self._column({self._limits[r]: amount / self._scale[r] for r, amount in entries}, 0.0)

    def add(self, column: Configuration) -> None:
        """Allow a configuration."""
        entries = {self._limits[r]: n / self._scale[r] for r, n in self._rows.load(column).items()}
        entries[self._serve[column.stream_class]] = 1.0
        if self._floor is not None:
            entries[self._floor] = self._goal.floored(column)
        self._column(entries, self._goal.worth(column))

    def solve(self) -> LinearSolution:
        """The optimum over the columns so far."""
        status = self._solver.Solve()
        if status not in (pywraplp.Solver.OPTIMAL, pywraplp.Solver.FEASIBLE):
            raise ValueError(f"GLOP ended the master problem with status {status}")
        duals = np.array([row.dual_value() for row in self._limits]) / self._scale
        floor = 0.0 if self._floor is None else max(0.0, -self._floor.dual_value())
        unserved = sum(
            variable.solution_value()
            for variable, rank in zip(self._unserved, self._ranks, strict=True)
            if rank < len(self._spared)
        )
        served = np.array([row.dual_value() for row in self._serve])
        prices = np.array(self._goal.prices)
        prices[: len(self._spared)] += [min(0.0, row.dual_value()) for row in self._spared]
        return LinearSolution(
            self._solver.Objective().Value() + self._goal.spared_worth,
            served,
            prices,
            np.maximum(duals, 0.0),
            floor,
            unserved - sum(self._goal.spared),
        )

    def _column(self, entries: dict[pywraplp.Constraint, float], worth: float) -> pywraplp.Variable:
        variable = self._solver.NumVar(0.0, self._solver.infinity(), "")
        for row, amount in entries.items():
            row.SetCoefficient(variable, float(amount))
        self._solver.Objective().SetCoefficient(variable, worth)
        return variable


def _scale(rows: Rows) -> FloatArray:
    """float64 (rows,): the greatest amount in each row."""
    scale = np.ones(len(rows.limit))
    for uses in rows.uses:
        for row, amount in uses:
            scale[row] = max(scale[row], float(abs(amount)))
    return scale
