"""All configurations of a stream class that can still be in an optimal plan.

If no plan is worth more than ``bound`` and one worth ``incumbent`` is known, then every configuration of a
better plan is worth, at the bound's prices, less than ``bound - incumbent`` below its class's best (reduced
cost fixing; Baldacci, Christofides, Mingozzi 2008). An integer master over all of these has the optimum.
"""

from __future__ import annotations

import itertools
import time
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
    aggregation: Aggregation, states: States, number: int, prices: Prices, least: float, buffer: IntArray
) -> list[tuple[Choice, ...]] | None:
    """All configurations of class ``number`` worth at least ``least``; None if the buffer, int64 (room, most
    detectors), has not the room for them.

    Of those that use the same kinds and go on with as many substreams only the most valuable is given.
    """
    items = _Items(aggregation, states, number, prices)
    found: list[tuple[Choice, ...]] = []
    used = 0
    for pattern in states.patterns:
        slots = [states.periods.index(period) for period in pattern]
        if items.hope(slots) < least:
            continue
        rows = items.of_pattern(slots, least, buffer[used:, : len(slots)])
        if rows is None:
            return None
        used += len(rows)
        if len(rows):
            found += items.best(rows)
    return found


def add_enumerated(
    aggregation: Aggregation,
    states: States,
    columns: Columns,
    prices: Sequence[Prices],
    least: tuple[float, ...],
    room: int,
    deadline_s: float,
) -> bool:
    """Add all configurations worth their class's least to the columns; False if there are too many, or if
    time.monotonic() passes deadline_s.

    prices, least: by class.
    """
    buffer = np.empty((room, max(map(len, states.patterns), default=0)), dtype=np.int64)
    for number, of_class in enumerate(least):
        found = enumerate_class(aggregation, states, number, prices[number], of_class, buffer[:room])
        if found is None or time.monotonic() > deadline_s:
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
        self._hope: list[float] = []
        for period in states.periods:
            here = [
                (k, b)
                for k, kind in enumerate(aggregation.kinds)
                if kind.period == period
                for b in np.flatnonzero(stream_class.allowed[k]).tolist()
            ]
            chosen += sorted(here, key=lambda choice: -hope[choice])
            best = hope[chosen[first[-1]]] if here else -np.inf
            self._hope.append(float(best))
            first.append(len(chosen))
        if prices.value == 0.0 and prices.kept == 0.0:
            chosen, first = _lightest(aggregation, chosen, first)
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

    def hope(self, slots: Sequence[int]) -> float:
        """No choice for these slots (numbers of periods) is worth more, links still to be paid."""
        return sum(self._hope[slot] for slot in slots)

    def of_pattern(self, slots: Sequence[int], least: float, buffer: IntArray) -> IntArray | None:
        """Numbers of items (N, slots) of all choices worth the least; None for more than the buffer holds."""
        numbers = np.array(slots, dtype=np.int64)
        count = enumerate_pattern(numbers, *self._arguments, least, buffer)
        return None if count < 0 else buffer[:count]

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


def _lightest(
    aggregation: Aggregation, chosen: list[Choice], first: list[int]
) -> tuple[list[Choice], list[int]]:
    """Only the level of each kind that loads the link least: nothing else matters where nothing has a value.

    first: where each period begins, and the end.
    """
    kept: list[Choice] = []
    begins = [0]
    for begin, end in itertools.pairwise(first):
        least: dict[int, Choice] = {}
        for choice in chosen[begin:end]:
            known = least.get(choice[0])
            if known is None or aggregation.load[choice] < aggregation.load[known]:
                least[choice[0]] = choice
        kept += least.values()
        begins.append(len(kept))
    return kept, begins
