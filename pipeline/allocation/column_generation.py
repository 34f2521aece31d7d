"""Column generation: configurations are priced until none would better the relaxed master problem.

Every round gives a bound too: with the duals as prices, no plan is worth more than the best configuration of
each stream plus what the machines are worth (Lagrangian duality; valid for any prices of at least 0, so
rounding in the linear solver cannot spoil it).
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

from pipeline.allocation.aggregation import Aggregation
from pipeline.allocation.configuration import Choice, Configuration, configuration
from pipeline.allocation.linear_master import Goal, LinearMaster, LinearSolution
from pipeline.allocation.master import Rows
from pipeline.allocation.pricing import Priced, Pricer, Prices

#: an improvement below this is none
TOLERANCE = 1e-9
#: of the covering patterns of a class, so many give a column per round
_COLUMNS_PER_ROUND = 6


class Columns:
    """The configurations so far, each once, in the order of finding."""

    def __init__(self, aggregation: Aggregation) -> None:
        self.all: list[Configuration] = []
        self._aggregation = aggregation
        self._known: set[tuple[int, tuple[Choice, ...]]] = set()

    def add(self, stream_class: int, choices: tuple[Choice, ...]) -> Configuration | None:
        """The new configuration, or None if it is known."""
        key = (stream_class, choices)
        if key in self._known:
            return None
        self._known.add(key)
        self.all.append(configuration(self._aggregation, stream_class, choices))
        return self.all[-1]


@dataclass(frozen=True, eq=False)
class Relaxation:
    """The end of column generation.

    bound: no plan is worth more (in the goal's unit, a float). prices: by class, of the kinds, the objective
    and kept substreams, at which it was computed. best: per class the greatest worth of a configuration at
    these prices, -inf if it has none; stake: the same or, if it is greater, that of going unserved. unserved:
    see LinearSolution. complete: no configuration betters it.
    """

    bound: float
    prices: tuple[Prices, ...]
    best: tuple[float, ...]
    stake: tuple[float, ...]
    unserved: float
    complete: bool


def relax(
    aggregation: Aggregation, rows: Rows, pricer: Pricer, columns: Columns, goal: Goal, deadline_s: float
) -> Relaxation:
    """Generate columns until the relaxation is solved, or time.monotonic() passes deadline_s."""
    master = LinearMaster(aggregation, rows, goal)
    for column in columns.all:
        master.add(column)
    best: Relaxation | None = None
    while True:
        solution = master.solve()
        prices = tuple(_prices(rows, goal, solution, c) for c in range(len(aggregation.classes)))
        offers = [
            pricer.best(c, p, _COLUMNS_PER_ROUND) for c, p in zip(aggregation.classes, prices, strict=True)
        ]
        bests = tuple(max((o.profit for o in of_class), default=-math.inf) for of_class in offers)
        ranks = [stream_class.rank for stream_class in aggregation.classes]
        stake = tuple(max(b, -float(solution.prices[r])) for b, r in zip(bests, ranks, strict=True))
        bound = _bound(aggregation, rows, goal, solution, stake)
        found = Relaxation(bound, prices, bests, stake, solution.unserved, complete=False)
        if best is None or bound < best.bound:
            best = found
        added = _add_best(columns, offers, solution, master)
        gap = bound - solution.worth
        if added == 0 or gap <= TOLERANCE * max(1.0, abs(bound)):
            return replace(best, unserved=solution.unserved, complete=True)
        if time.monotonic() > deadline_s:
            return replace(best, unserved=solution.unserved)


def _prices(rows: Rows, goal: Goal, solution: LinearSolution, stream_class: int) -> Prices:
    value = {"value": 1.0, "kept": solution.floor_dual, "nothing": 0.0}[goal.of]
    kept = {"value": solution.floor_dual, "kept": 1.0, "nothing": 0.0}[goal.of]
    return Prices(rows.prices(solution.duals, stream_class), value, kept)


def _bound(
    aggregation: Aggregation,
    rows: Rows,
    goal: Goal,
    solution: LinearSolution,
    stake: tuple[float, ...],
) -> float:
    worth = rows.machines_worth(solution.duals)
    if goal.floor is not None:
        worth -= solution.floor_dual * goal.floor_worth
    for of_stream, stream_class in zip(stake, aggregation.classes, strict=True):
        worth += len(stream_class.streams) * of_stream
    return worth + sum(n * float(p) for n, p in zip(goal.spared, solution.prices, strict=False))


def _add_best(
    columns: Columns, offers: list[list[Priced]], solution: LinearSolution, master: LinearMaster
) -> int:
    added = 0
    for number, of_class in enumerate(offers):
        better = [o for o in of_class if o.profit > solution.served[number] + TOLERANCE]
        for offer in better:
            column = columns.add(number, offer.choices)
            if column is not None:
                master.add(column)
                added += 1
    return added
