"""The master problem in whole numbers, in CP-SAT, over given configurations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ortools.sat.python import cp_model

from pipeline.allocation.aggregation import Aggregation
from pipeline.allocation.configuration import Configuration
from pipeline.allocation.linear_master import Goal
from pipeline.allocation.master import Rows
from pipeline.allocation.memory import GroupMemory

#: a kept substream, and of a goal of nothing the price 1, in goal units
KEPT_UNITS = 10**6


@dataclass(frozen=True)
class IntegerSolution:
    """counts: streams per configuration. supply: machines per pattern column. slots: by group without listed
    patterns, per machine how many of each size. missing: streams without a configuration, by rank. unserved:
    of these, those that the goal does not spare. value, kept: sums over the configurations. worth: of the
    goal, in its units (see ``goal_units``). proven: the search ended.
    """

    counts: tuple[int, ...]
    supply: tuple[int, ...]
    slots: dict[int, tuple[tuple[int, ...], ...]]
    missing: tuple[int, ...]
    unserved: int
    value: int
    kept: int
    worth: int
    proven: bool

    def rank(self) -> tuple[int, int]:
        """The greater, the better: first streams served, then worth."""
        return -self.unserved, 0 if self.unserved else self.worth


def goal_units(goal: Goal, column: Configuration) -> int:
    """What one stream in a configuration adds, as a whole number: objective units, or kept substreams."""
    if goal.of == "nothing":
        return 0
    return column.value if goal.of == "value" else column.kept * KEPT_UNITS


def solve_integer(
    aggregation: Aggregation,
    rows: Rows,
    goal: Goal,
    columns: Sequence[Configuration],
    *,
    time_limit_s: float,
    seed: int,
    bound: int,
    gap_limit: float = 0.0,
    hint: IntegerSolution | None = None,
) -> IntegerSolution | None:
    """The best whole combination of the columns; None if none was found in time.

    Streams may stay unserved, at a price above every other gain; for a goal of nothing, at the goal's. bound:
    no plan is worth more, in goal units: the search ends when it is reached. gap_limit: relative gap at which
    to stop.
    """
    model = cp_model.CpModel()
    streams = [len(c.streams) for c in aggregation.classes]
    taken = [model.new_int_var(0, streams[c.stream_class], f"take_{i}") for i, c in enumerate(columns)]
    unserved = [model.new_int_var(0, n, f"unserved_{c}") for c, n in enumerate(streams)]
    supply = [model.new_int_var(0, _most(rows, s), f"supply_{s}") for s in range(len(rows.supply))]
    for c, n in enumerate(streams):
        mine = [take for take, column in zip(taken, columns, strict=True) if column.stream_class == c]
        model.add(sum(mine) + unserved[c] == n)
    _group_rows(model, rows, columns, taken, supply)
    slots = _slots(model, rows, columns, taken)
    units = [goal_units(goal, column) for column in columns]
    prices = _prices(goal, units, sum(streams))
    missing = _missing(model, aggregation, goal, unserved)
    spared = sum(n * price for n, price in zip(goal.spared, prices, strict=False))
    worth = (
        cp_model.LinearExpr.weighted_sum(taken, units)
        - cp_model.LinearExpr.weighted_sum(missing, prices)
        + spared
    )
    model.add(worth <= bound)
    model.maximize(worth)
    if goal.floor is not None:
        floored = [c.kept if goal.of == "value" else c.value for c in columns]
        model.add(cp_model.LinearExpr.weighted_sum(taken, floored) >= goal.floor)
    if hint is not None:
        _hint(model, taken, supply, hint)
    solver = cp_model.CpSolver()
    solver.parameters.max_time_in_seconds = max(time_limit_s, 0.01)
    solver.parameters.catch_sigint_signal = False  # else it takes Ctrl-C for itself, and keeps it
    solver.parameters.num_workers = 1
    solver.parameters.random_seed = seed
    solver.parameters.relative_gap_limit = gap_limit
    solver.parameters.absolute_gap_limit = 0.0
    status = solver.solve(model)
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return None
    counts = tuple(solver.value(take) for take in taken)
    unserved_of = tuple(solver.value(n) for n in missing)
    return IntegerSolution(
        counts,
        tuple(solver.value(s) for s in supply),
        {g: tuple(tuple(solver.value(u) for u in one) for one in machines) for g, machines in slots.items()},
        unserved_of,
        sum(n - known for n, known in zip(unserved_of, goal.spared, strict=False)),
        sum(n * column.value for n, column in zip(counts, columns, strict=True)),
        sum(n * column.kept for n, column in zip(counts, columns, strict=True)),
        round(solver.objective_value),
        status == cp_model.OPTIMAL,
    )


def _prices(goal: Goal, units: Sequence[int], streams: int) -> list[int]:
    """Of a stream unserved, by rank, in goal units."""
    if goal.of == "nothing":
        return [round(price) * KEPT_UNITS for price in goal.prices]
    return [1 + 2 * max((abs(u) for u in units), default=0) * streams] * len(goal.prices)


def _missing(
    model: cp_model.CpModel, aggregation: Aggregation, goal: Goal, unserved: Sequence[cp_model.IntVar]
) -> list[cp_model.IntVar]:
    """How many streams of each rank go unserved; at least those that are spared."""
    missing = []
    for rank, streams in enumerate(aggregation.streams_of_rank):
        least = goal.spared[rank] if rank < len(goal.spared) else 0
        missing.append(model.new_int_var(least, streams, f"missing_{rank}"))
        mine = [n for n, c in zip(unserved, aggregation.classes, strict=True) if c.rank == rank]
        model.add(sum(mine) == missing[-1])
    return missing


def _most(rows: Rows, supply: int) -> int:
    count_row = rows.supply[supply][-1][0]
    return int(rows.limit[count_row])


def _group_rows(
    model: cp_model.CpModel,
    rows: Rows,
    columns: Sequence[Configuration],
    taken: list[cp_model.IntVar],
    supply: list[cp_model.IntVar],
) -> None:
    terms: list[list[tuple[cp_model.IntVar, int]]] = [[] for _ in rows.limit]
    for take, column in zip(taken, columns, strict=True):
        for row, amount in rows.load(column).items():
            terms[row].append((take, amount))
    for use, entries in zip(supply, rows.supply, strict=True):
        for row, amount in entries:
            terms[row].append((use, amount))
    for of_row, limit in zip(terms, rows.limit.tolist(), strict=True):
        variables, amounts = [v for v, _ in of_row], [a for _, a in of_row]
        model.add(cp_model.LinearExpr.weighted_sum(variables, amounts) <= limit)


def _slots(
    model: cp_model.CpModel, rows: Rows, columns: Sequence[Configuration], taken: list[cp_model.IntVar]
) -> dict[int, list[list[cp_model.IntVar]]]:
    """Variables of each machine of the groups whose patterns are too many to list."""
    found: dict[int, list[list[cp_model.IntVar]]] = {}
    for g, memory in enumerate(rows.memories):
        if memory is None or memory.patterns is not None:
            continue
        found[g] = [_machine_slots(model, memory) for _ in range(memory.machines)]
        for i in range(len(memory.sizes)):
            uses = [sum(rows.size_of[k] == (g, i) for k in column.kinds) for column in columns]
            room = sum(of_machine[i] for of_machine in found[g])
            model.add(cp_model.LinearExpr.weighted_sum(taken, uses) <= room)
    return found


def _machine_slots(model: cp_model.CpModel, memory: GroupMemory) -> list[cp_model.IntVar]:
    """How many of each size one machine holds."""
    slots = [model.new_int_var(0, most, "") for most in memory.most]
    if memory.capacity is not None:
        sizes = [size for size, _ in memory.sizes]
        model.add(cp_model.LinearExpr.weighted_sum(slots, sizes) <= memory.capacity)
    for slot, (_, sharing) in zip(slots, memory.sizes, strict=True):
        if sharing is not None:
            used = model.new_bool_var("")
            model.add(slot <= sharing * used)
            model.add(sum(slots) <= sharing).only_enforce_if(used)
    return slots


def _hint(
    model: cp_model.CpModel,
    taken: list[cp_model.IntVar],
    supply: list[cp_model.IntVar],
    hint: IntegerSolution,
) -> None:
    for variable, value in zip(taken, hint.counts, strict=False):
        model.add_hint(variable, value)
    for variable, value in zip(supply, hint.supply, strict=True):
        model.add_hint(variable, value)
