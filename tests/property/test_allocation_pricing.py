"""The best configuration, and all good ones, against every configuration there is."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_allocation_decomposed_optimality import problems

from pipeline.allocation.aggregation import Aggregation, aggregate
from pipeline.allocation.configuration import Choice, configuration
from pipeline.allocation.covering import phases_of
from pipeline.allocation.enumeration import enumerate_class
from pipeline.allocation.pricing import Pricer, Prices
from pipeline.allocation.problem import OBJECTIVE_RESOLUTION, Problem


def every_configuration(found: Aggregation, number: int) -> list[tuple[Choice, ...]]:
    problem, of_class = found.problem, found.classes[number]
    choices = [(int(k), int(b)) for k, b in np.argwhere(of_class.allowed)]
    result = []
    for n in range(1, problem.detectors_per_stream + 1):
        for chosen in itertools.combinations_with_replacement(choices, n):
            copies = Counter(k for k, _ in chosen)
            loads: Counter[int] = Counter()
            for choice in chosen:
                loads[found.kinds[choice[0]].site] += int(found.load[choice])
            periods = tuple(sorted(found.kinds[k].period for k, _ in chosen))
            if (
                all(count <= found.kinds[k].copies for k, count in copies.items())
                and all(load <= of_class.capacity[site] for site, load in loads.items())
                and phases_of(periods, problem.detectors_per_frame) is not None
            ):
                result.append(chosen)
    return result


def worth(found: Aggregation, number: int, chosen: tuple[Choice, ...], prices: Prices) -> float:
    column = configuration(found, number, chosen)
    gained = prices.value * column.value * OBJECTIVE_RESOLUTION + prices.kept * column.kept
    return gained - sum(float(prices.kinds[k]) for k, _ in chosen)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(problems(), st.integers(0, 2**32 - 1), st.sampled_from((0.0, 0.3, 1.0)), st.sampled_from((0.0, 1.0)))
def test_pricing_and_enumeration_find_what_brute_force_finds(
    problem: Problem, seed: int, value: float, kept: float
) -> None:
    rng = np.random.default_rng(seed)
    running = frozenset(
        (problem.streams[0], d.id, float(rng.choice(problem.bitrates_bps)), "")
        for d in problem.detectors
        if rng.random() < 0.3
    )
    found = aggregate(problem, kept=running)
    if len(found.kinds) > 5 or problem.detectors_per_stream > 3:
        return
    pricer = Pricer(found)
    prices = Prices(np.round(rng.exponential(0.1, len(found.kinds)), 3), value, kept)
    for number in range(len(found.classes)):
        everything = every_configuration(found, number)
        worths = [worth(found, number, chosen, prices) for chosen in everything]
        best = pricer.best(found.classes[number], prices)
        assert bool(best) == bool(everything)
        if best:
            top = max(best, key=lambda one: one.profit)
            assert top.profit == pytest.approx(max(worths), abs=1e-9)
            assert worth(found, number, top.choices, prices) == pytest.approx(top.profit, abs=1e-9)
            least = max(worths) - 0.2
            buffer = np.empty((10**6, problem.detectors_per_stream), dtype=np.int64)
            listed = enumerate_class(found, pricer.states, number, prices, least, buffer)
            assert listed is not None
            good = [c for c, w in zip(everything, worths, strict=True) if w >= least]
            if value or kept:
                assert kinds_and_kept(found, number, listed) == kinds_and_kept(found, number, good)
            else:  # nothing matters but which kinds
                assert kinds(listed) == kinds(good)
                assert set(listed) <= set(good)


def kinds(listed: list[tuple[Choice, ...]]) -> set[tuple[int, ...]]:
    return {tuple(kind for kind, _ in chosen) for chosen in listed}


def kinds_and_kept(
    found: Aggregation, number: int, listed: list[tuple[Choice, ...]]
) -> dict[tuple[tuple[int, ...], int], int]:
    """The greatest value for each multiset of kinds and number of kept substreams."""
    best: dict[tuple[tuple[int, ...], int], int] = {}
    for chosen in listed:
        column = configuration(found, number, chosen)
        key = column.kinds, column.kept
        best[key] = max(best.get(key, column.value), column.value)
    return best
