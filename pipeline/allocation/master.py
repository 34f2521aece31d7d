"""The master problem: how many streams of each class take each configuration.

Sizes alone do not keep a stream from using one detector twice. Where a packing fails for that reason a *cut*
is added (``Cut``), a condition that every packing meets and the failed one does not.

Rows: one per class (its streams are all served), and those of the machine groups. A group with listed
patterns has one row per size, ``used - held by the chosen patterns <= 0``, and one for its number of
machines. A group with too many patterns has one row for its whole memory, and one for sharing (a detector
that allows k at most takes at least 1/k of a machine); the integer master gives each of its machines
variables of its own.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.allocation.aggregation import Aggregation, Kind
from pipeline.allocation.configuration import Configuration
from pipeline.allocation.memory import GroupMemory, group_memory
from pipeline.messages import FloatArray


@dataclass(frozen=True)
class Cut:
    """What some detectors of one size in a group need because those of one pair lie on different machines.

    members: (class, kind); pairs: how many pairs (stream, kind) these are. A machine holds each pair at most
    once, so that the members' detectors are at most the sum over machines of min(room for the size, pairs)
    (Gale 1957, Ryser 1957).
    """

    group: int
    size: int
    members: frozenset[tuple[int, int]]
    pairs: int


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of the machine groups.

    uses: per kind its (row, amount). size_of: per kind its group and size, None if it takes nothing. limit:
    int64 (rows,). supply: per pattern column its (row, amount), with negative amounts where it offers room.
    memories: by group; None where nothing limits it. supplies: by group, the numbers of
    its pattern columns.
    """

    uses: tuple[tuple[tuple[int, int], ...], ...]
    size_of: tuple[tuple[int, int] | None, ...]
    limit: NDArray[np.int64]
    supply: tuple[tuple[tuple[int, int], ...], ...]
    memories: tuple[GroupMemory | None, ...]
    supplies: tuple[tuple[int, ...], ...]
    cuts: tuple[tuple[int, Cut], ...]

    def prices(self, duals: FloatArray, stream_class: int) -> FloatArray:
        """float64 (kinds,): what one detector of each kind pays for the rows when this class uses it."""
        prices = np.array([sum(amount * duals[row] for row, amount in uses) for uses in self.uses])
        for row, cut in self.cuts:
            for number, kind in cut.members:
                if number == stream_class:
                    prices[kind] += duals[row]
        return prices

    def machines_worth(self, duals: FloatArray) -> float:
        """The greatest worth of all machines at these prices (duals at least 0): part of the bound."""
        worth = float(self.limit @ duals)
        for memory, supplies in zip(self.memories, self.supplies, strict=True):
            if memory is not None and memory.patterns is not None:
                # the row of the number of machines counts a pattern's own worth, not its dual
                count_row = self.supply[supplies[0]][-1][0]
                worth -= self.limit[count_row] * duals[count_row]
                best = max(-sum(amount * duals[row] for row, amount in self.supply[s][:-1]) for s in supplies)
                worth += memory.machines * max(best, 0.0)
        return worth

    def load(self, chosen: Configuration) -> dict[int, int]:
        """Amount per row of a configuration."""
        amounts: Counter[int] = Counter()
        for kind in chosen.kinds:
            for row, amount in self.uses[kind]:
                amounts[row] += amount
            for row, cut in self.cuts:
                amounts[row] += (chosen.stream_class, kind) in cut.members
        return {row: amount for row, amount in amounts.items() if amount}


def rows_of(aggregation: Aggregation, cuts: Sequence[Cut] = ()) -> Rows:
    """The rows of all groups, and of the cuts; a group with a cut has listed patterns."""
    memories = tuple(group_memory(aggregation, g) for g in range(len(aggregation.groups)))
    limit: list[int] = []
    supply: list[tuple[tuple[int, int], ...]] = []
    first_row, supplies = [], []
    for memory in memories:
        first_row.append(len(limit))
        begun = len(supply)
        if memory is not None and memory.patterns is not None:
            count_row = len(limit) + len(memory.sizes)
            for pattern in memory.patterns:
                offered = [(len(limit) + i, -n) for i, n in enumerate(pattern) if n]
                supply.append((*offered, (count_row, 1)))
            limit += [0] * len(memory.sizes) + [memory.machines]
        elif memory is not None:
            limit += [memory.machines * (memory.capacity or 0), memory.machines * _sharing_unit(memory)]
        supplies.append(tuple(range(begun, len(supply))))
    first_cut = len(limit)
    limit += [0] * len(cuts)
    for row, cut in enumerate(cuts, start=first_cut):
        memory = memories[cut.group]
        assert memory is not None
        assert memory.patterns is not None
        for s, pattern in zip(supplies[cut.group], memory.patterns, strict=True):
            room = min(pattern[cut.size], cut.pairs)
            supply[s] = ((row, -room), *supply[s]) if room else supply[s]
    uses = tuple(_uses(kind, memories[kind.group], first_row[kind.group]) for kind in aggregation.kinds)
    size_of = tuple(_size_of(kind, memories[kind.group]) for kind in aggregation.kinds)
    return Rows(
        uses,
        size_of,
        np.array(limit, dtype=np.int64),
        tuple(supply),
        memories,
        tuple(supplies),
        tuple(enumerate(cuts, start=first_cut)),
    )


def _size_of(kind: Kind, memory: GroupMemory | None) -> tuple[int, int] | None:
    if memory is None:
        return None
    size = kind.size if memory.capacity is not None else 0, kind.sharing
    return (kind.group, memory.sizes.index(size)) if size in memory.sizes else None


def _uses(kind: Kind, memory: GroupMemory | None, first_row: int) -> tuple[tuple[int, int], ...]:
    found = _size_of(kind, memory)
    if memory is None or found is None:
        return ()
    number = found[1]
    if memory.patterns is not None:
        return ((first_row + number, 1),)
    size, sharing = memory.sizes[number]
    of_machine = 0 if sharing is None else _sharing_unit(memory) // sharing
    return tuple((first_row + i, amount) for i, amount in enumerate((size, of_machine)) if amount)


def _sharing_unit(memory: GroupMemory) -> int:
    return math.lcm(*(sharing for _, sharing in memory.sizes if sharing is not None))
