"""The one clock of a process, handed to whoever waits or stamps; tests hand in another."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Clock:
    """monotonic_s: for every wait and every duration; its zero means nothing. sleep: seconds.

    utc_ns: ns UTC, for stamps alone: it is set by hand, by GPS and by NTP, and may jump at any moment.
    """

    monotonic_s: Callable[[], float] = time.monotonic
    sleep: Callable[[float], None] = time.sleep
    utc_ns: Callable[[], int] = time.time_ns

    def monotonic_of(self, utc_s: float) -> float:
        """The monotonic time of a moment of UTC, as the clocks stand now; ask once, then keep to the answer."""
        return self.monotonic_s() + utc_s - self.utc_ns() * 1e-9
