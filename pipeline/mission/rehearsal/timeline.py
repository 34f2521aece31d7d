"""Virtual time: what is to happen, in order."""

from __future__ import annotations

import heapq
from collections.abc import Callable


class Timeline:
    """now: seconds. What is put at the same time happens in the order in which it was put."""

    def __init__(self) -> None:
        self.now = 0.0
        self._count = 0
        self._due: list[tuple[float, int, Callable[[], None]]] = []

    def at(self, time_s: float, act: Callable[[], None]) -> None:
        """Let something happen at a time, now at the earliest."""
        self._count += 1
        heapq.heappush(self._due, (max(time_s, self.now), self._count, act))

    def after(self, delay_s: float, act: Callable[[], None]) -> None:
        """Let something happen a while from now."""
        self.at(self.now + delay_s, act)

    def run(self, until_s: float, is_over: Callable[[], bool]) -> None:
        """Let happen what is due, until a time or until it is over."""
        while self._due and not is_over():
            time_s, _, act = heapq.heappop(self._due)
            if time_s > until_s:
                return
            self.now = time_s
            act()
