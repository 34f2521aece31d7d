"""What fits on the machines of a group: sizes, and the patterns in which one machine can be filled.

Detectors that take the same memory, under the same condition on sharing, are of one *size*. A *pattern* says
how many of each size one machine holds. Machines of a group are interchangeable, so that so many detectors of
each size fit the group if, and only if, as many patterns as it has machines hold them (up to two copies of
one detector for one stream on one machine, which ``packing`` excludes).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

from pipeline.allocation.aggregation import Aggregation

#: more patterns than this are not listed: every machine then gets variables of its own
MAX_PATTERNS = 3000

Size = tuple[int, int | None]
"""Memory units, and Detector.sharing."""


@dataclass(frozen=True)
class GroupMemory:
    """sizes: the sizes that count; a kind that takes nothing counts in none. most: how many of each may be
    asked for. patterns: all maximal ones, number per size; None if there are too many to list. machines: how
    many. capacity: memory units of one machine, None without a limit.
    """

    sizes: tuple[Size, ...]
    most: tuple[int, ...]
    patterns: tuple[tuple[int, ...], ...] | None
    machines: int
    capacity: int | None


def group_memory(aggregation: Aggregation, group: int) -> GroupMemory | None:
    """The memory of a group, or None if nothing limits it."""
    kinds = [kind for kind in aggregation.kinds if kind.group == group]
    machines = aggregation.groups[group]
    shared = any(kind.sharing is not None for kind in kinds)
    streams = len(aggregation.problem.streams)
    most: dict[Size, int] = {}
    for kind in kinds:
        if shared or (machines.memory is not None and kind.size > 0):
            size = kind.size if machines.memory is not None else 0, kind.sharing
            most[size] = most.get(size, 0) + streams
    if not most:
        return None
    sizes = tuple(sorted(most, key=lambda size: (-size[0], size[1] or 0)))
    limits = tuple(most[size] for size in sizes)
    listed = tuple(itertools.islice(_maximal(sizes, limits, machines.memory), MAX_PATTERNS + 1))
    patterns = None if len(listed) > MAX_PATTERNS else listed
    return GroupMemory(sizes, limits, patterns, len(machines.machines), machines.memory)


def fits(pattern: tuple[int, ...], sizes: tuple[Size, ...], capacity: int | None) -> bool:
    """Whether one machine holds so many of each size."""
    if capacity is not None and sum(n * size for n, (size, _) in zip(pattern, sizes, strict=True)) > capacity:
        return False
    together = sum(pattern)
    return all(
        sharing is None or n == 0 or together <= sharing
        for n, (_, sharing) in zip(pattern, sizes, strict=True)
    )


def _maximal(
    sizes: tuple[Size, ...], most: tuple[int, ...], capacity: int | None
) -> Iterator[tuple[int, ...]]:
    """The patterns that hold no more of any size; lexically descending."""
    for pattern in _fitting(sizes, most, capacity, ()):
        grown = (
            (*pattern[:i], pattern[i] + 1, *pattern[i + 1 :])
            for i in range(len(sizes))
            if pattern[i] < most[i]
        )
        if not any(fits(larger, sizes, capacity) for larger in grown):
            yield pattern


def _fitting(
    sizes: tuple[Size, ...], most: tuple[int, ...], capacity: int | None, begun: tuple[int, ...]
) -> Iterator[tuple[int, ...]]:
    i = len(begun)
    if i == len(sizes):
        yield begun
        return
    size, sharing = sizes[i]
    room = most[i]
    if capacity is not None and size > 0:
        left = capacity - sum(n * s for n, (s, _) in zip(begun, sizes, strict=False))
        room = min(room, left // size)
    limits = [k for n, (_, k) in zip(begun, sizes, strict=False) if n and k is not None]
    strictest = min(limits, default=None)
    last_without_rule = i == len(sizes) - 1 and strictest is None and sharing is None
    for n in [room] if last_without_rule else range(room, -1, -1):
        rule = min([k for k in (strictest, sharing if n else None) if k is not None], default=None)
        if rule is None or sum(begun) + n <= rule:
            yield from _fitting(sizes, most, capacity, (*begun, n))
