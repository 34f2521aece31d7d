"""The master problem: how many streams of each class take each configuration.

Rows: one per class (its streams are all served), and those of the machine groups. A group with listed
patterns has one row per size, ``used - held by the chosen patterns <= 0``, and one for its number of
machines. A group with too many patterns has one row for its whole memory, and one for sharing (a detector
that allows k at most takes at least 1/k of a machine); the integer master gives each of its machines
variables of its own.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.allocation.aggregation import Aggregation, Kind
from pipeline.allocation.configuration import Configuration
from pipeline.allocation.memory import GroupMemory, group_memory
from pipeline.messages import FloatArray


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of the machine groups.

    uses: per kind its (row, amount). size_of: per kind its group and size, None if it takes nothing. limit:
    int64 (rows,). supply: per pattern column its (row, amount), with negative amounts where it offers room.
    memories: by group; None where nothing limits it. first_row: by group. supplies: by group, the numbers of
    its pattern columns.
    """

    uses: tuple[tuple[tuple[int, int], ...], ...]
    size_of: tuple[tuple[int, int] | None, ...]
    limit: NDArray[np.int64]
    supply: tuple[tuple[tuple[int, int], ...], ...]
    memories: tuple[GroupMemory | None, ...]
    first_row: tuple[int, ...]
    supplies: tuple[tuple[int, ...], ...]

    def prices(self, duals: FloatArray) -> FloatArray:
        """float64 (kinds,): what one detector of each kind pays for the rows."""
        return np.array([sum(amount * duals[row] for row, amount in uses) for uses in self.uses])

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
        return dict(amounts)


def rows_of(aggregation: Aggregation) -> Rows:
    """The rows of all groups."""
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
    uses = tuple(_uses(kind, memories[kind.group], first_row[kind.group]) for kind in aggregation.kinds)
    size_of = tuple(_size_of(kind, memories[kind.group]) for kind in aggregation.kinds)
    return Rows(
        uses,
        size_of,
        np.array(limit, dtype=np.int64),
        tuple(supply),
        memories,
        tuple(first_row),
        tuple(supplies),
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
