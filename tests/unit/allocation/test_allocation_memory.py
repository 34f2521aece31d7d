"""What fits on one machine: all maximal patterns, and no other."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

from pipeline.allocation.aggregation import aggregate
from pipeline.allocation.memory import GroupMemory, fits, group_memory
from pipeline.allocation.problem import Problem

Tiny = Callable[..., Problem]
STREAMS = ("u", "v", "w")


def memory(problem: Problem) -> GroupMemory:
    found = group_memory(aggregate(problem), 0)
    assert found is not None
    return found


def maximal_by_brute_force(found: GroupMemory) -> set[tuple[int, ...]]:
    everything = [
        p
        for p in itertools.product(*(range(most + 1) for most in found.most))
        if fits(p, found.sizes, found.capacity)
    ]
    return {
        p
        for p in everything
        if not any(q != p and all(a >= b for a, b in zip(q, p, strict=True)) for q in everything)
    }


def test_the_patterns_are_all_maximal_ways_to_fill_a_machine(tiny: Tiny) -> None:
    problem = tiny(
        ("a", 1, 0.5, 2.0), ("b", 1, 0.5, 3.0), ("c", 1, 0.5, 4.0), machine_gb=9.0, streams=STREAMS
    )
    found = memory(problem)
    assert found.patterns is not None
    assert set(found.patterns) == maximal_by_brute_force(found)
    assert len(found.patterns) == len(set(found.patterns))


def test_sharing_limits_how_many_a_pattern_holds(tiny: Tiny) -> None:
    problem = tiny(("a", 1, 0.5, 2.0), ("b", 1, 0.5, 3.0), machine_gb=20.0, streams=STREAMS)
    modes = tuple(replace(d, id=f"{d.id}@{n}", sharing=n) for d in problem.detectors for n in (1, 2))
    found = memory(replace(problem, detectors=modes))
    assert found.patterns is not None
    assert set(found.patterns) == maximal_by_brute_force(found)
    assert max(map(sum, found.patterns)) == 2


def test_one_detector_per_machine_is_a_pattern_of_one(tiny: Tiny) -> None:
    problem = tiny(("a", 1, 0.5, 2.0), ("b", 1, 0.5, 3.0), memory_rule="one_detector_per_machine")
    assert memory(problem).patterns == ((1,),)


def test_a_machine_without_a_limit_has_no_patterns(tiny: Tiny) -> None:
    assert group_memory(aggregate(tiny(("a", 1, 0.5, 2.0), machine_gb=float("inf"))), 0) is None
