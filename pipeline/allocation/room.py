"""What is left of the machines while detectors are put on them one by one."""

from __future__ import annotations

import math
from collections import Counter

from pipeline.allocation.problem import Detector, Problem, memory_units


class Room:
    """The machines of a problem, under its memory rule; empty at first."""

    def __init__(self, problem: Problem) -> None:
        self._one_only = problem.memory_rule == "one_detector_per_machine"
        self._left: dict[str, float] = {
            m.id: math.inf
            if math.isinf(m.memory_bytes)
            else 1
            if self._one_only
            else memory_units(m.memory_bytes)
            for m in problem.machines
        }
        self._here: dict[str, Counter[int | None]] = {m.id: Counter() for m in problem.machines}

    def holds(self, detector: Detector) -> bool:
        """Whether there is room for one more of this detector."""
        if detector.machine not in self._left or self._size(detector) > self._left[detector.machine]:
            return False
        here = self._here[detector.machine]
        limits = [sharing for sharing in (*here, detector.sharing) if sharing is not None]
        return here.total() < min(limits, default=math.inf)

    def left(self, machine: str) -> float:
        """Memory units (see ``problem``) left, or detectors where a machine runs one; infinite: no limit."""
        return self._left[machine]

    def put(self, detector: Detector) -> None:
        """One more of this detector runs on its machine."""
        self._left[detector.machine] -= self._size(detector)
        self._here[detector.machine][detector.sharing] += 1

    def take(self, detector: Detector) -> None:
        """One of this detector is gone from its machine."""
        self._left[detector.machine] += self._size(detector)
        self._here[detector.machine] -= Counter([detector.sharing])

    def _size(self, detector: Detector) -> int:
        return 1 if self._one_only else memory_units(detector.memory_bytes)
