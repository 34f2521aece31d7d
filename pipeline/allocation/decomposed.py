"""The default solver: the same optimum as the paper's program, found by decomposition.

A used detector is only a phase, so a stream chooses a covering pattern (``covering``); machines of one group
and streams of one class are interchangeable (``aggregation``, ``memory``); what is left is a master problem
over stream configurations, solved by column generation with an integer master (``search``). Names come back
in ``packing``.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace

from pipeline.allocation.aggregation import Aggregation, Kept
from pipeline.allocation.checked import checked
from pipeline.allocation.configuration import Choice, Configuration
from pipeline.allocation.covering import phases_near
from pipeline.allocation.distinctness import Distinctions, Unpacked, tell_apart
from pipeline.allocation.gap import GAP_UNITS
from pipeline.allocation.integer_master import IntegerSolution
from pipeline.allocation.master import Rows
from pipeline.allocation.packing import Stay, Use, pack_group
from pipeline.allocation.plan import Assignment, Plan, Status, objective
from pipeline.allocation.problem import OBJECTIVE_RESOLUTION, Detector, Problem
from pipeline.allocation.proven_optimum import Found, Search

#: a plan this near its bound is optimal: the search's own tolerance, and that of rounding each gain
GAP_TOLERANCE = 2 * GAP_UNITS * OBJECTIVE_RESOLUTION


def solve(
    problem: Problem, *, time_limit_s: float, workers: int = 1, seed: int = 0, gap_limit: float = 0.0
) -> Plan:
    """The best plan, with proof; after the time limit the best found, with its bound.

    The same problem gives the same plan, unless the time limit ends the search. workers: of no use here, all
    is done by one. gap_limit: a plan this near its bound is enough (``Plan.gap``). Raises NoPlanError where
    detPerStream allows too many covering patterns, and InvalidPlanError if what was found breaks a limit.
    """
    start = time.perf_counter()
    deadline_s = time.monotonic() + time_limit_s
    known = Distinctions()
    search = known.search(problem, frozenset(), deadline_s=deadline_s, seed=seed)
    while True:
        found = search.solve(search.value_goal(), gap_limit)
        if found.solution is None:
            return without_plan(problem, found.status, time.perf_counter() - start, search)
        placed = place(search.aggregation, search.rows, found, deadline_s=deadline_s)
        if not isinstance(placed, Unpacked):
            return checked(problem, finished(problem, found, placed, time.perf_counter() - start, search))
        before, known = known, tell_apart(search, placed, known)
        if known != before:
            search = known.search(problem, frozenset(), deadline_s=deadline_s, seed=seed)


def finished(
    problem: Problem, best: Found, assignments: tuple[Assignment, ...], solve_s: float, search: Search
) -> Plan:
    """The plan of these assignments; best: the search for the best objective, whose bound it is given."""
    assert best.bound is not None
    value = objective(problem, assignments)
    slack = max(best.bound * OBJECTIVE_RESOLUTION - value, 0.0)
    slack = 0.0 if slack <= GAP_TOLERANCE else slack
    gap = slack / max(1.0, abs(value))
    status: Status = "feasible" if slack else "optimal"
    return Plan(status, value, value + slack, gap, problem.cycle, assignments, solve_s, *_size(search))


def without_plan(problem: Problem, status: Status, solve_s: float, search: Search) -> Plan:
    """The answer that there is no plan, or none yet."""
    return Plan(status, None, None, None, problem.cycle, (), solve_s, *_size(search))


def place(
    aggregation: Aggregation,
    rows: Rows,
    found: Found,
    running: Sequence[Assignment] = (),
    *,
    deadline_s: float,
    least_s: float = 1.0,
) -> tuple[Assignment, ...] | Unpacked:
    """Give the detectors of a solution machines and phases, where possible those of a running plan.

    least_s: the time that each group of machines may take even if the deadline has come.
    """
    assert found.solution is not None
    uses = _uses(aggregation, found.columns, found.solution)
    by_group: dict[int, list[Use]] = defaultdict(list)
    for use in uses:
        by_group[aggregation.kinds[use.kind].group].append(use)
    stays = _stays(aggregation, running)
    detectors: list[tuple[Use, int]] = []
    for g, of_group in sorted(by_group.items()):
        filled = _filled(rows, found.solution, g)
        limit_s = max(deadline_s - time.monotonic(), least_s)
        machines = pack_group(aggregation, rows, g, of_group, filled, stays.get(g, ()), limit_s)
        if machines is None:
            return Unpacked(g, tuple(of_group), tuple(filled))
        detectors += zip(of_group, machines, strict=True)
    by_id = {d.id: d for d in aggregation.problem.detectors}
    uses_on = [
        (use.stream, (use.kind, use.level), by_id[aggregation.kinds[use.kind].detectors[m]])
        for use, m in detectors
    ]
    return named(aggregation.problem, uses_on, running)


def still_there(problem: Problem, running: Sequence[Assignment]) -> tuple[Assignment, ...]:
    """The substreams of a running plan whose detector is still the same: network, machine, site and setup.

    What else may have changed (period, levels, links, ..) decides whether they can go on.
    """
    by_id = {d.id: d for d in problem.detectors}
    streams = frozenset(problem.streams)
    found: dict[tuple[str, str], Assignment] = {}
    for a in running:
        d = by_id.get(a.detector)
        same = d is not None and (d.detector, d.machine, d.site, d.setup) == (
            a.pool_detector,
            a.machine,
            a.site,
            a.setup,
        )
        if same and a.stream in streams:
            found.setdefault((a.stream, a.detector), a)
    return tuple(found.values())


def kept_of(running: Sequence[Assignment]) -> Kept:
    """The substreams of a running plan, by what they keep."""
    return frozenset((a.stream, a.detector, a.bitrate_bps, a.codec) for a in running)


def _size(search: Search) -> tuple[int, int]:
    """Variables and constraints of the master problem."""
    columns = len(search.columns.all) + len(search.rows.supply)
    return columns, len(search.aggregation.classes) + len(search.rows.limit)


def _uses(aggregation: Aggregation, columns: Sequence[Configuration], solution: IntegerSolution) -> list[Use]:
    """The columns dealt out to the streams of their class, in order."""
    waiting = [list(stream_class.streams) for stream_class in aggregation.classes]
    uses = []
    for column, count in zip(columns, solution.counts, strict=False):
        for _ in range(count):
            stream = waiting[column.stream_class].pop(0)
            uses += [Use(stream, kind, level) for kind, level in column.choices]
    return uses


def _filled(rows: Rows, solution: IntegerSolution, group: int) -> list[tuple[int, ...]]:
    """How many of each size each machine of the group is to hold."""
    memory = rows.memories[group]
    if memory is None:
        return []
    if memory.patterns is None:
        return list(solution.slots[group])
    counts = [solution.supply[s] for s in rows.supplies[group]]
    return [p for p, n in zip(memory.patterns, counts, strict=True) for _ in range(n)]


def _stays(aggregation: Aggregation, running: Sequence[Assignment]) -> dict[int, list[Stay]]:
    where = {
        detector: (k, m)
        for k, kind in enumerate(aggregation.kinds)
        for m, detector in enumerate(kind.detectors)
    }
    stays: dict[int, list[Stay]] = defaultdict(list)
    for a in running:
        level = aggregation.problem.level(a.bitrate_bps, a.codec)
        if a.detector in where and level is not None:
            k, m = where[a.detector]
            use = Use(a.stream, k, level)
            stays[aggregation.kinds[k].group].append(Stay(use, m))
    return stays


def named(
    problem: Problem, uses: Iterable[tuple[str, Choice, Detector]], running: Sequence[Assignment]
) -> tuple[Assignment, ...]:
    """The assignments of (stream, choice, detector), with phases that cover, those of the running plan where
    these still do.
    """
    by_stream: dict[str, list[Assignment]] = defaultdict(list)
    for stream, (_, level), d in uses:
        bitrate_bps, codec = problem.bitrates_bps[level], problem.codec(level)
        where = (stream, d.id, d.detector, d.machine, d.site)
        by_stream[stream].append(Assignment(*where, d.period, 0, bitrate_bps, codec, d.setup))
    before = {(a.stream, a.detector): a.phase for a in running}
    phased = [a for of_stream in by_stream.values() for a in _phased(problem, of_stream, before)]
    return tuple(sorted(phased, key=lambda a: (a.stream, a.phase, a.detector)))


def _phased(
    problem: Problem, of_stream: list[Assignment], before: dict[tuple[str, str], int]
) -> list[Assignment]:
    """The assignments of one stream with phases that cover, as before where these still do."""
    ordered = sorted(of_stream, key=lambda a: (a.period, a.detector))
    wanted = tuple(before.get((a.stream, a.detector)) for a in ordered)
    phases = phases_near(tuple(a.period for a in ordered), wanted, problem.detectors_per_frame)
    assert phases is not None
    return [replace(a, phase=phase) for a, phase in zip(ordered, phases, strict=True)]
