"""What is left of a machine while detectors are put on it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from pipeline.allocation.problem import Problem
from pipeline.allocation.room import Room


def test_memory_is_taken_and_given_back(tiny: Callable[..., Problem]) -> None:
    of = tiny(("a", 1, 0.5, 4.0), ("b", 1, 0.5, 3.0))
    a, b = of.detectors
    room = Room(of)
    for detector in (a, b):
        room.put(detector)
    assert room.left("m") == 3e6
    assert room.holds(b)
    assert not room.holds(a)
    room.take(b)
    assert room.holds(a)


def test_one_detector_per_machine(tiny: Callable[..., Problem]) -> None:
    of = tiny(("a", 1, 0.5, 4.0), memory_rule="one_detector_per_machine")
    room = Room(of)
    assert room.holds(of.detectors[0])
    room.put(of.detectors[0])
    assert not room.holds(of.detectors[0])


def test_a_machine_without_a_limit_holds_any_number(tiny: Callable[..., Problem]) -> None:
    of = tiny(("a", 1, 0.5, 4.0), machine_gb=math.inf)
    room = Room(of)
    for _ in range(50):
        room.put(of.detectors[0])
    assert room.holds(of.detectors[0])


def test_sharing_limits_the_newcomer_and_those_that_are_there(tiny: Callable[..., Problem]) -> None:
    of = tiny(("a", 1, 0.5, 1.0), ("b", 1, 0.5, 1.0))
    two, any_number = replace(of.detectors[0], sharing=2), of.detectors[1]
    room = Room(of)
    room.put(any_number)
    assert room.holds(two)
    room.put(two)
    assert not room.holds(any_number)
    assert not room.holds(two)
    room.take(two)
    room.put(any_number)
    assert not room.holds(two)
    assert room.holds(any_number)


def test_a_detector_of_no_machine_has_no_room(tiny: Callable[..., Problem]) -> None:
    of = tiny(("a", 1, 0.5, 1.0))
    assert not Room(of).holds(replace(of.detectors[0], machine="gone"))
