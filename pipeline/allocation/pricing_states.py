"""The states of pricing: every multiset of periods that some covering pattern contains."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.allocation.covering import Pattern, covering_patterns

IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class States:
    """States by number, the smaller ones first; 0 is the empty one.

    periods: distinct, ascending. add: (states, periods), see ``pricing_kernels``. first_split, split_here,
    split_rest: all ways to share a state between two. rest: what is left of a state without a part of it.
    covering: numbers of the states that are covering patterns. patterns: those patterns.
    """

    periods: tuple[int, ...]
    add: IntArray
    first_split: IntArray
    split_here: IntArray
    split_rest: IntArray
    rest: Mapping[tuple[int, int], int]
    covering: IntArray
    patterns: tuple[Pattern, ...]


@lru_cache(maxsize=64)
def states_of(periods: tuple[int, ...], per_stream: int, per_frame: int) -> States:
    """The states of all covering patterns; see ``covering_patterns`` for the arguments and errors."""
    patterns = covering_patterns(periods, per_stream, per_frame)
    members = {()}.union(*(_contained(pattern) for pattern in patterns)) if patterns else {()}
    ordered = sorted(members, key=lambda state: (len(state), state))
    number = {state: q for q, state in enumerate(ordered)}
    add = np.full((len(ordered), len(periods)), -1, dtype=np.int64)
    for state, q in number.items():
        for p, period in enumerate(periods):
            add[q, p] = number.get(tuple(sorted((*state, period))), -1)
    splits = [
        [(number[part], number[_without(state, part)]) for part in _contained(state)] for state in ordered
    ]
    flat = list(itertools.chain.from_iterable(splits))
    return States(
        periods,
        add,
        np.cumsum([0, *map(len, splits)]).astype(np.int64),
        np.array([here for here, _ in flat], dtype=np.int64),
        np.array([rest for _, rest in flat], dtype=np.int64),
        {(q, here): rest for q, of_state in enumerate(splits) for here, rest in of_state},
        np.array([number[pattern] for pattern in patterns], dtype=np.int64),
        patterns,
    )


def _contained(pattern: Pattern) -> list[Pattern]:
    """All multisets within a multiset, the empty one and itself included."""
    counts = Counter(pattern)
    choices = itertools.product(*(range(count + 1) for count in counts.values()))
    return [
        tuple(sorted(itertools.chain.from_iterable([p] * n for p, n in zip(counts, take, strict=True))))
        for take in choices
    ]


def _without(state: Pattern, part: Pattern) -> Pattern:
    return tuple(sorted((Counter(state) - Counter(part)).elements()))
