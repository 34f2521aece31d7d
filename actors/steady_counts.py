"""Counts for Prometheus never fall, though processes come and go, and some of what they say is not final."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable
from dataclasses import dataclass, field


@dataclass
class _Count:
    """before: of processes that are gone. newest: of the one that counts now. shown: the most that was ever said."""

    process: int
    before: float = 0.0
    newest: float = 0.0
    shown: float = 0.0


@dataclass
class SteadyCounts:
    """settle_s: what is counted may be taken back so long; only what stood all that time is final."""

    settle_s: float = 5.0
    _counts: dict[Hashable, _Count] = field(default_factory=dict)
    _recent: dict[Hashable, deque[tuple[float, float]]] = field(default_factory=dict)

    def of(self, key: Hashable, value: float, process: int = 0) -> float:
        """The count of a key by all processes. process: a new one counts from 0 on; what it takes back stays."""
        count = self._counts.setdefault(key, _Count(process))
        if process != count.process:
            count.before, count.process = count.before + count.newest, process
        count.newest = value
        count.shown = max(count.shown, count.before + value)
        return count.shown

    def settled(self, key: Hashable, value: float, now_s: float) -> float:
        """Of a count that may be taken back: as much of it as stood for ``settle_s``."""
        recent = self._recent.setdefault(key, deque([(now_s - self.settle_s, 0.0)]))
        recent.append((now_s, value))
        while len(recent) > 1 and recent[1][0] <= now_s - self.settle_s:
            recent.popleft()
        return self.of(key, min(count for _, count in recent))
