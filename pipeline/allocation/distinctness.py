"""When detectors fit a group by size, but not without one stream using a detector twice: what to add, to go
on.

With listed patterns a cut is added. It speaks of pairs (stream, kind), so that the streams in it must first
be classes of their own. Without listed patterns the machines of the group are told apart: a stream then has
one detector of each kind on each of them, and nothing is left to be confused.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pipeline.allocation.aggregation import NO_RANKS, Kept, aggregate
from pipeline.allocation.master import Cut
from pipeline.allocation.packing import Use, violated
from pipeline.allocation.problem import Problem
from pipeline.allocation.proven_optimum import Search


@dataclass(frozen=True)
class Unpacked:
    """A group, all its detectors in use, and how many of each size each machine was to hold."""

    group: int
    uses: tuple[Use, ...]
    filled: tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class Distinctions:
    """What is told apart so far: machines, and streams."""

    machines: frozenset[str] = frozenset()
    streams: frozenset[str] = frozenset()

    def search(
        self,
        problem: Problem,
        kept: Kept,
        *,
        deadline_s: float,
        seed: int,
        ranks: Mapping[str, int] = NO_RANKS,
    ) -> Search:
        """A new search with these distinctions."""
        aggregation = aggregate(problem, self.machines, kept, self.streams, ranks)
        return Search(aggregation, deadline_s=deadline_s, seed=seed)


def tell_apart(search: Search, unpacked: Unpacked, known: Distinctions) -> Distinctions:
    """Exclude the failed packing: by a cut in the search, or else by what is given back, for a new search."""
    pairs = violated(search.rows, unpacked.group, unpacked.uses, unpacked.filled)
    if pairs is None:
        machines = search.aggregation.groups[unpacked.group].machines
        return Distinctions(known.machines | set(machines), known.streams)
    number = {stream: c for c, one in enumerate(search.aggregation.classes) for stream in one.streams}
    classes = [search.aggregation.classes[number[stream]] for stream, _ in pairs]
    several = {stream for one in classes if len(one.streams) > 1 for stream in one.streams}
    if several:
        return Distinctions(known.machines, known.streams | several)
    members = frozenset((number[stream], kind) for stream, kind in pairs)
    size = search.rows.size_of[pairs[0][1]]
    assert size is not None
    search.cut(Cut(unpacked.group, size[1], members, len(pairs)))
    return known
