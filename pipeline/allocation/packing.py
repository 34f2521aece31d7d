"""From kinds to machines: which machine of its group runs each detector.

The integer master counts detectors by size only. Here every machine gets names, so that none is filled beyond
its memory and no stream uses one detector twice. Substreams of a running plan stay where they are if they
can.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from ortools.sat.python import cp_model

from pipeline.allocation.aggregation import Aggregation
from pipeline.allocation.master import Rows
from pipeline.allocation.memory import GroupMemory, fits


@dataclass(frozen=True)
class Use:
    """One detector in use: a stream, a kind, a level."""

    stream: str
    kind: int
    level: int


@dataclass(frozen=True)
class Stay:
    """A use that runs already, and the number of its machine within the group."""

    use: Use
    machine: int


def pack_group(
    aggregation: Aggregation,
    rows: Rows,
    group: int,
    uses: Sequence[Use],
    filled: Sequence[Sequence[int]],
    stays: Sequence[Stay],
    time_limit_s: float,
) -> list[int] | None:
    """The number of the machine for each use, or None if the uses do not fit.

    uses: all of the group; of equal ones each is a copy. filled: the integer master's pattern per machine,
    may be shorter than the group. As many stays as possible stay; if the time limit ends the search, perhaps
    fewer. Without stays, uses that do not fit the patterns are given up at once where a cut excludes them.
    """
    machines = len(aggregation.groups[group].machines)
    memory = rows.memories[group]
    if not stays:
        found = _greedy(rows, uses, memory, machines, filled)
        if found is not None or _soon_excluded(aggregation, rows, group, uses, filled):
            return found
    first = _with_stays(rows, uses, memory, machines, stays)
    if first is not None:
        return first
    return _search(rows, uses, memory, machines, stays, time_limit_s)


def violated(
    rows: Rows, group: int, uses: Sequence[Use], filled: Sequence[Sequence[int]]
) -> Sequence[tuple[str, int]] | None:
    """Pairs (stream, kind) of one size that have more detectors than the filled machines have room for them,
    the pairs with most first; None if no condition of the kind of ``Cut`` fails.
    """
    memory = rows.memories[group]
    if memory is None or memory.patterns is None:
        return None
    for size in range(len(memory.sizes)):
        mine = [use for use in uses if rows.size_of[use.kind] == (group, size)]
        pairs = Counter((use.stream, use.kind) for use in mine).most_common()
        for k in range(1, len(pairs) + 1):
            room = sum(min(pattern[size], k) for pattern in filled)
            if sum(count for _, count in pairs[:k]) > room:
                return [pair for pair, _ in pairs[:k]]
    return None


def _soon_excluded(
    aggregation: Aggregation,
    rows: Rows,
    group: int,
    uses: Sequence[Use],
    filled: Sequence[Sequence[int]],
) -> bool:
    """Whether a cut can exclude these patterns as things stand: the search then goes on with its columns,
    which takes less time than to look through all other patterns here.
    """
    pairs = violated(rows, group, uses, filled)
    alone = {c.streams[0] for c in aggregation.classes if len(c.streams) == 1}
    return pairs is not None and all(stream in alone for stream, _ in pairs)


def _greedy(
    rows: Rows,
    uses: Sequence[Use],
    memory: GroupMemory | None,
    machines: int,
    filled: Sequence[Sequence[int]],
) -> list[int] | None:
    """Fill the patterns: the uses with most copies first, each copy on the machine with most room left.

    For given patterns this finds a packing if there is one (the degree sequences of Gale and Ryser).
    """
    room = [list(pattern) for pattern in filled] + [
        [0] * len(memory.sizes) if memory else [] for _ in range(machines - len(filled))
    ]
    load, result = [0] * machines, [0] * len(uses)
    copies = Counter((use.stream, use.kind) for use in uses)
    taken: dict[tuple[str, int], set[int]] = defaultdict(set)
    order = sorted(range(len(uses)), key=lambda i: -copies[uses[i].stream, uses[i].kind])
    for i in order:
        use = uses[i]
        size = rows.size_of[use.kind]
        free = [m for m in range(machines) if m not in taken[use.stream, use.kind]]
        if size is not None:
            free = [m for m in free if room[m][size[1]] > 0]
        if not free:
            return None
        m = min(free, key=lambda m: (-room[m][size[1]] if size is not None else 0, load[m], m))
        if size is not None:
            room[m][size[1]] -= 1
        load[m] += 1
        taken[use.stream, use.kind].add(m)
        result[i] = m
    return result


def _with_stays(
    rows: Rows, uses: Sequence[Use], memory: GroupMemory | None, machines: int, stays: Sequence[Stay]
) -> list[int] | None:
    """All stays stay, the others go where they fit, the largest first; None if that fails."""
    result = [-1] * len(uses)
    here: list[list[Use]] = [[] for _ in range(machines)]
    waiting: dict[Use, list[int]] = defaultdict(list)
    for stay in stays:
        waiting[stay.use].append(stay.machine)
    for i, use in enumerate(uses):
        if waiting[use]:
            result[i] = waiting[use].pop(0)
            here[result[i]].append(use)
    if any(not _allowed(rows, memory, of_machine) for of_machine in here):
        return None
    left = [i for i, m in enumerate(result) if m < 0]
    for i in sorted(left, key=lambda i: -_bytes(rows, memory, uses[i])):
        able = [m for m in range(machines) if _allowed(rows, memory, [*here[m], uses[i]])]
        if not able:
            return None
        result[i] = min(able, key=lambda m: (len(here[m]), m))
        here[result[i]].append(uses[i])
    return result


def _bytes(rows: Rows, memory: GroupMemory | None, use: Use) -> int:
    size = rows.size_of[use.kind]
    return 0 if memory is None or size is None else memory.sizes[size[1]][0]


def _allowed(rows: Rows, memory: GroupMemory | None, here: Sequence[Use]) -> bool:
    if len({(use.stream, use.kind) for use in here}) < len(here):
        return False
    if memory is None:
        return True
    counts = [0] * len(memory.sizes)
    for use in here:
        size = rows.size_of[use.kind]
        if size is not None:
            counts[size[1]] += 1
    return fits(tuple(counts), memory.sizes, memory.capacity)


def _search(
    rows: Rows,
    uses: Sequence[Use],
    memory: GroupMemory | None,
    machines: int,
    stays: Sequence[Stay],
    time_limit_s: float,
) -> list[int] | None:
    """The packing in which most stays stay, by CP-SAT."""
    model = cp_model.CpModel()
    copies = Counter(uses)
    distinct = list(copies)
    on = {(use, m): model.new_bool_var("") for use in distinct for m in range(machines)}
    for use, n in copies.items():
        model.add(sum(on[use, m] for m in range(machines)) == n)
    by_detector: dict[tuple[str, int], list[Use]] = defaultdict(list)
    for use in distinct:
        by_detector[use.stream, use.kind].append(use)
    for m in range(machines):
        for same in by_detector.values():
            model.add_at_most_one(on[use, m] for use in same)
        if memory is not None:
            _machine_fits(model, rows, memory, [(use, on[use, m]) for use in distinct])
    model.maximize(sum(on[stay.use, stay.machine] for stay in stays if stay.use in copies))
    solver = cp_model.CpSolver()
    solver.parameters.max_time_in_seconds = max(time_limit_s, 0.01)
    solver.parameters.catch_sigint_signal = False  # else it takes Ctrl-C for itself, and keeps it
    solver.parameters.num_workers = 1
    if solver.solve(model) not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return None
    found = {use: [m for m in range(machines) if solver.value(on[use, m])] for use in distinct}
    return [found[use].pop(0) for use in uses]


def _machine_fits(
    model: cp_model.CpModel, rows: Rows, memory: GroupMemory, here: list[tuple[Use, cp_model.IntVar]]
) -> None:
    sized = [(memory.sizes[size[1]], on) for use, on in here if (size := rows.size_of[use.kind]) is not None]
    if memory.capacity is not None:
        model.add(sum(size * on for (size, _), on in sized) <= memory.capacity)
    together = sum(on for _, on in sized)
    for (_, sharing), on in sized:
        if sharing is not None:
            model.add(together <= sharing).only_enforce_if(on)
