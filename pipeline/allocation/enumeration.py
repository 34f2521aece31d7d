"""All configurations of a stream class that can still be in an optimal plan.

If no plan is worth more than ``bound`` and one worth ``incumbent`` is known, then every configuration of a
better plan is worth, at the bound's prices, less than ``bound - incumbent`` below its class's best (reduced
cost fixing; Baldacci, Christofides, Mingozzi 2008). An integer master over all of these has the optimum.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.allocation.aggregation import Aggregation
from pipeline.allocation.column_generation import Columns
from pipeline.allocation.configuration import Choice
from pipeline.allocation.enumeration_kernels import enumerate_pattern
from pipeline.allocation.pricing import Prices
from pipeline.allocation.pricing_states import IntArray, States
from pipeline.allocation.problem import OBJECTIVE_RESOLUTION


def enumerate_class(
    aggregation: Aggregation, states: States, number: int, prices: Prices, least: float, room: int
) -> list[tuple[Choice, ...]] | None:
    """All configurations of class ``number`` worth at least ``least``; None if more than ``room`` were looked
    at.

    Of those that use the same kinds and go on with as many substreams only the most valuable is given.
    """
    items = _Items(aggregation, states, number, prices)
    found: list[tuple[Choice, ...]] = []
    for pattern in states.patterns:
        rows = items.of_pattern(states, pattern, least, room)
        if rows is None:
            return None
        room -= len(rows)
        found += items.best(rows)
    return found


def add_enumerated(
    aggregation: Aggregation,
    states: States,
    columns: Columns,
    prices: Sequence[Prices],
    least: tuple[float, ...],
    room: int,
) -> bool:
    """Add all configurations worth their class's least to the columns; False if there are too many.

    prices, least: by class.
    """
    for number, of_class in enumerate(least):
        found = enumerate_class(aggregation, states, number, prices[number], of_class, room)
        if found is None:
            return False
        room -= len(found)
        for choices in found:
            columns.add(number, choices)
    return True


class _Items:
    """Every allowed (kind, level) of a class at given prices, by period, the most profitable first."""

    def __init__(self, aggregation: Aggregation, states: States, number: int, prices: Prices) -> None:
        stream_class = aggregation.classes[number]
        value = stream_class.value * (prices.value * OBJECTIVE_RESOLUTION) - prices.kinds[:, None]
        hope = value + prices.kept * (stream_class.kept > 0)
        chosen: list[Choice] = []
        first = [0]
        for period in states.periods:
            here = [
                (k, b)
                for k, kind in enumerate(aggregation.kinds)
                if kind.period == period
                for b in np.flatnonzero(stream_class.allowed[k]).tolist()
            ]
            chosen += sorted(here, key=lambda choice: -hope[choice])
            first.append(len(chosen))
        self.choices = chosen
        kinds = np.array([k for k, _ in chosen], dtype=np.int64)
        levels = np.array([b for _, b in chosen], dtype=np.int64)
        self._kinds = kinds
        self._sites = np.array([aggregation.kinds[k].site for k in kinds], dtype=np.int64)
        self._values, self._kept = stream_class.value[kinds, levels], stream_class.kept[kinds, levels]
        self._penalty = aggregation.penalty
        self._arguments = (
            np.array(first, dtype=np.int64),
            kinds,
            self._sites,
            aggregation.load[kinds, levels],
            value[kinds, levels],
            self._kept,
            float(prices.kept),
            np.array([kind.copies for kind in aggregation.kinds], dtype=np.int64),
            stream_class.capacity,
            aggregation.penalty * OBJECTIVE_RESOLUTION * prices.value,
        )

    def of_pattern(
        self, states: States, pattern: tuple[int, ...], least: float, room: int
    ) -> IntArray | None:
        """Numbers of items (N, detectors) of all choices worth the least; None for more than room."""
        slots = np.array([states.periods.index(period) for period in pattern], dtype=np.int64)
        found = np.empty((max(room, 1), len(slots)), dtype=np.int64)
        count = enumerate_pattern(slots, *self._arguments, least, found)
        return None if count < 0 else found[:count]

    def best(self, rows: IntArray) -> list[tuple[Choice, ...]]:
        """Of the rows with equal kinds and as many substreams that go on, the most valuable."""
        kinds, sites = np.sort(self._kinds[rows], axis=1), np.sort(self._sites[rows], axis=1)
        links = 1 + (np.diff(sites, axis=1) != 0).sum(axis=1)
        value = self._values[rows].sum(axis=1) - self._penalty * links
        kept = np.zeros(len(rows), dtype=np.int64)
        for j in range(rows.shape[1]):
            before = (rows[:, :j] == rows[:, j : j + 1]).sum(axis=1)
            kept += before < self._kept[rows[:, j]]
        order = np.lexsort((-value, kept, *kinds.T))
        key = np.column_stack([kinds, kept])[order]
        first = np.ones(len(rows), dtype=bool)
        first[1:] = (key[1:] != key[:-1]).any(axis=1)
        return [tuple(sorted(self.choices[i] for i in row)) for row in rows[order[first]].tolist()]
