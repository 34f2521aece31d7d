"""All configurations of a stream class that can still be in an optimal plan.

If no plan is worth more than ``bound`` and one worth ``incumbent`` is known, then every configuration of a
better plan is worth, at the bound's prices, less than ``bound - incumbent`` below its class's best (reduced
cost fixing; Baldacci, Christofides, Mingozzi 2008). An integer master over all of these has the optimum.
"""

from __future__ import annotations

import numpy as np

from pipeline.allocation.aggregation import Aggregation
from pipeline.allocation.column_generation import Columns
from pipeline.allocation.configuration import Choice, configuration
from pipeline.allocation.enumeration_kernels import enumerate_pattern
from pipeline.allocation.pricing import Prices
from pipeline.allocation.problem import OBJECTIVE_RESOLUTION
from pipeline.allocation.states import States


def enumerate_class(
    aggregation: Aggregation, states: States, number: int, prices: Prices, least: float, room: int
) -> list[tuple[Choice, ...]] | None:
    """All configurations of class ``number`` worth at least ``least``; None if more than ``room`` were looked
    at.

    Of those that use the same kinds and go on with as many substreams only the most valuable is given.
    """
    items = _Items(aggregation, states, number, prices)
    found: dict[tuple[tuple[int, ...], int], tuple[int, tuple[Choice, ...]]] = {}
    for pattern in states.patterns:
        choices = items.of_pattern(states, pattern, least, room)
        if choices is None:
            return None
        room -= len(choices)
        for chosen in choices:
            column = configuration(aggregation, number, chosen)
            key = (column.kinds, column.kept)
            if key not in found or column.value > found[key][0]:
                found[key] = column.value, column.choices
    return [choices for _, choices in found.values()]


def add_enumerated(
    aggregation: Aggregation,
    states: States,
    columns: Columns,
    prices: Prices,
    least: tuple[float, ...],
    room: int,
) -> bool:
    """Add all configurations worth their class's least to the columns; False if there are too many."""
    for number, of_class in enumerate(least):
        found = enumerate_class(aggregation, states, number, prices, of_class, room)
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
        self._arguments = (
            np.array(first, dtype=np.int64),
            kinds,
            np.array([aggregation.kinds[k].site for k in kinds], dtype=np.int64),
            aggregation.load[kinds, levels],
            value[kinds, levels],
            stream_class.kept[kinds, levels],
            float(prices.kept),
            np.array([kind.copies for kind in aggregation.kinds], dtype=np.int64),
            stream_class.capacity,
            aggregation.penalty * OBJECTIVE_RESOLUTION * prices.value,
        )

    def of_pattern(
        self, states: States, pattern: tuple[int, ...], least: float, room: int
    ) -> list[tuple[Choice, ...]] | None:
        slots = np.array([states.periods.index(period) for period in pattern], dtype=np.int64)
        found = np.empty((max(room, 1), len(slots)), dtype=np.int64)
        count = enumerate_pattern(slots, *self._arguments, least, found)
        if count < 0:
            return None
        return [tuple(sorted(self.choices[i] for i in row)) for row in found[:count].tolist()]
