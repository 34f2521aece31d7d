"""The best configuration of a stream class when machines have prices: the pricing of column generation.

Within a site the bandwidth couples the choices, so every state has a front of (load, profit) there; sites are
then combined by a convolution over states. The search is exact. Detectors that a stream cannot use up (as
many copies as it may use) compete only within their period and level; of the others no more than detPerStream
per period and level can be in a best configuration, since an unused better one could always take the place.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.allocation.aggregation import FORBIDDEN, Aggregation, StreamClass
from pipeline.allocation.configuration import Choice
from pipeline.allocation.pricing_kernels import combine_sites, site_fronts
from pipeline.allocation.pricing_states import IntArray, States, states_of
from pipeline.allocation.problem import OBJECTIVE_RESOLUTION
from pipeline.messages import FloatArray

_FRONT = 64
_NODES = 1 << 14


@dataclass(frozen=True, eq=False)
class Prices:
    """What a configuration is worth at the moment.

    kinds: float64 (kinds,), price of one detector of each kind. value, kept: what a unit of objective and one
    kept substream are worth.
    """

    kinds: FloatArray
    value: float = 1.0
    kept: float = 0.0


@dataclass(frozen=True)
class Priced:
    """A best configuration for one covering pattern, and its worth after prices."""

    profit: float
    choices: tuple[Choice, ...]


@dataclass
class _Unit:
    """One detector to use: options (load, profit, choice), ascending in load and profit."""

    period: int
    repeat: bool
    options: list[tuple[int, float, Choice]]


class Pricer:
    """Finds best configurations in one aggregation."""

    def __init__(self, aggregation: Aggregation) -> None:
        problem = aggregation.problem
        periods = tuple(sorted({kind.period for kind in aggregation.kinds}))
        self.states: States = states_of(periods, problem.detectors_per_stream, problem.detectors_per_frame)
        self._aggregation = aggregation
        self._penalty = aggregation.penalty * OBJECTIVE_RESOLUTION
        self._per_stream = problem.detectors_per_stream
        self._by_site_and_period: dict[tuple[int, int], list[int]] = {}
        for k, kind in enumerate(aggregation.kinds):
            self._by_site_and_period.setdefault((kind.site, periods.index(kind.period)), []).append(k)
        self._copies = np.array([kind.copies for kind in aggregation.kinds], dtype=np.int64)
        self._front, self._nodes = _FRONT, _NODES

    def best(
        self,
        stream_class: StreamClass,
        prices: Prices,
        most: int | None = None,
        copies: IntArray | None = None,
    ) -> list[Priced]:
        """For each covering pattern that the class can have, the best configuration; the best ones first.

        most: only so many of them. copies: int64 (kinds,), where a stream can use fewer of them than ``Kind``
        says; a kind with none must not be allowed.
        """
        copies = self._copies if copies is None else copies
        profits = self._profits(stream_class, prices)
        states = len(self.states.add)
        total = np.full(states, -np.inf)
        total[0] = 0.0
        fronts, taken = [], []
        for site in range(len(self._aggregation.problem.sites)):
            units = list(self._units(site, stream_class, prices, profits, copies))
            if not units:
                continue
            fronts.append(self._site(units, int(stream_class.capacity[site])))
            taken.append(np.zeros(states, dtype=np.int64))
            combine_sites(
                self.states.first_split,
                self.states.split_here,
                self.states.split_rest,
                fronts[-1].best,
                self._penalty * prices.value,
                total,
                taken[-1],
            )
        covering = self.states.covering[total[self.states.covering] > -np.inf]
        ranked = covering[np.argsort(-total[covering], kind="stable")][:most]
        return [Priced(float(total[q]), self._choices(int(q), fronts, taken)) for q in ranked]

    def _profits(self, stream_class: StreamClass, prices: Prices) -> FloatArray:
        value = self._aggregation.value_float(stream_class)
        worth = (
            np.where(stream_class.allowed, prices.value * value, FORBIDDEN)
            if prices.value
            else np.where(stream_class.allowed, 0.0, FORBIDDEN)
        )
        return np.asarray(worth - prices.kinds[:, None], dtype=np.float64)

    def _units(
        self, site: int, stream_class: StreamClass, prices: Prices, profits: FloatArray, copies: IntArray
    ) -> Iterator[_Unit]:
        for p in range(len(self.states.periods)):
            here = self._by_site_and_period.get((site, p), [])
            keeps = [k for k in here if prices.kept > 0.0 and stream_class.kept[k].any()]
            free = [k for k in here if copies[k] >= self._per_stream]
            floor = profits[free].max(axis=0) if free else np.full(profits.shape[1], FORBIDDEN)
            if free:
                best = np.asarray(free)[profits[free].argmax(axis=0)]
                yield from self._unit(p, True, floor, [(int(k), b) for b, k in enumerate(best)])
            limited = [k for k in here if k not in keeps and k not in free]
            for k in self._contenders(limited, profits, floor):
                for _ in range(int(copies[k])):
                    yield from self._unit(p, False, profits[k], [(k, b) for b in range(profits.shape[1])])
            for k in keeps:
                kept, worth = stream_class.kept[k], prices.kept
                if k in free:
                    yield from self._going_on(p, k, kept, profits[k], worth)
                else:
                    yield from self._keeping(p, int(copies[k]), k, kept, profits[k], worth)

    def _going_on(self, p: int, k: int, kept: IntArray, profits: FloatArray, worth: float) -> Iterator[_Unit]:
        """What goes on of a kind that cannot be used up: beside its other copies, which are free as any."""
        for level in np.repeat(np.arange(len(kept)), kept).tolist():
            if profits[level] > FORBIDDEN:
                load = int(self._aggregation.load[k, level])
                yield _Unit(p, False, [(load, float(profits[level] + worth), (k, level))])

    def _keeping(
        self, p: int, copies: int, k: int, kept: IntArray, profits: FloatArray, worth: float
    ) -> Iterator[_Unit]:
        """Copies of a kind of which some go on with what runs; each such copy is worth more at its level."""
        levels = np.repeat(np.arange(len(kept)), kept)
        for copy in range(copies):
            bonus = profits.copy()
            if copy < len(levels):
                bonus[levels[copy]] += worth
            yield from self._unit(p, False, bonus, [(k, b) for b in range(len(profits))])

    def _contenders(self, limited: list[int], profits: FloatArray, floor: FloatArray) -> list[int]:
        """The kinds that can be in a best configuration."""
        if not limited:
            return []
        worth = profits[limited]
        better = worth > floor
        if len(limited) > self._per_stream:
            rank = (-worth).argsort(axis=0, kind="stable").argsort(axis=0, kind="stable")
            better &= rank < self._per_stream
        wanted = np.flatnonzero(better.any(axis=1))
        return [limited[i] for i in wanted]

    def _unit(self, p: int, repeat: bool, profits: FloatArray, choices: list[Choice]) -> Iterator[_Unit]:
        """At most one unit: the options that no cheaper one dominates."""
        options: list[tuple[int, float, Choice]] = []
        for choice, profit in sorted(
            zip(choices, profits.tolist(), strict=True), key=lambda one: self._aggregation.load[one[0]]
        ):
            if profit > (options[-1][1] if options else FORBIDDEN):
                options.append((int(self._aggregation.load[choice]), profit, choice))
        if options:
            yield _Unit(p, repeat, options)

    def _site(self, units: list[_Unit], capacity: int) -> _SiteFronts:
        """Run the kernel, with more room until it is enough."""
        options = [option for unit in units for option in unit.options]
        first = np.cumsum([0, *(len(unit.options) for unit in units)]).astype(np.int64)
        states = len(self.states.add)
        while True:
            loads = np.empty((states, self._front), dtype=np.int64)
            profits = np.empty((states, self._front))
            nodes = np.empty((states, self._front), dtype=np.int64)
            parents = np.empty(self._nodes, dtype=np.int64)
            codes = np.empty(self._nodes, dtype=np.int64)
            sizes, used = site_fronts(
                self.states.add,
                capacity,
                np.array([unit.period for unit in units], dtype=np.int64),
                np.array([unit.repeat for unit in units], dtype=np.bool_),
                first,
                np.array([load for load, _, _ in options], dtype=np.int64),
                np.array([profit for _, profit, _ in options]),
                loads,
                profits,
                nodes,
                parents,
                codes,
            )
            if used >= 0:
                break
            self._front, self._nodes = 2 * self._front, 4 * self._nodes
        last = np.maximum(sizes - 1, 0)
        rows = np.arange(states)
        best = np.where(sizes > 0, profits[rows, last], -np.inf)
        return _SiteFronts(best, nodes[rows, last], parents, codes, [choice for _, _, choice in options])

    def _choices(self, q: int, fronts: list[_SiteFronts], taken: list[IntArray]) -> tuple[Choice, ...]:
        found: list[Choice] = []
        for front, here in zip(reversed(fronts), reversed(taken), strict=True):
            part = int(here[q])
            found += front.choices_of(part)
            q = self.states.rest[q, part]
        return tuple(sorted(found))


@dataclass(frozen=True, eq=False)
class _SiteFronts:
    """best: (states,) profit. node: (states,) of that profit. parents, codes: the nodes."""

    best: FloatArray
    node: IntArray
    parents: IntArray
    codes: IntArray
    options: list[Choice]

    def choices_of(self, state: int) -> list[Choice]:
        found, node = [], int(self.node[state]) if state else 0
        while node > 0:
            found.append(self.options[int(self.codes[node])])
            node = int(self.parents[node])
        return found
