"""Bytes, and seconds by what they were spent on."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field


@dataclass
class Meter:
    """Of one unit of work."""

    total_bytes: int = 0
    largest: int = 0
    seconds: dict[str, float] = field(default_factory=dict)

    def count(self, data: bytes) -> None:
        """One packet."""
        self.total_bytes += len(data)
        self.largest = max(self.largest, len(data))

    def spend(self, part: str, seconds: float) -> None:
        """So much more for a part of the work."""
        self.seconds[part] = self.seconds.get(part, 0.0) + seconds

    @contextmanager
    def spending(self, part: str) -> Iterator[None]:
        """What the block takes is spent on the part."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self.spend(part, time.perf_counter() - started)
