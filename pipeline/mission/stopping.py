"""The end of a run before its streams end: asked for once, within one time budget for all that must still be done."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass

from pipeline.errors import InputError, StoppedError


@dataclass(frozen=True)
class ShutdownParams:
    """budget_s: from the request to the end of the last step: what is on its way is waited for, actors are asked what
    they know, the map is written, Ray is stopped. publish_s: of it, kept for writing the map; without it a machine
    that does not answer would cost the map. The map is written whatever the time.
    """

    budget_s: float = 20.0
    publish_s: float = 10.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.publish_s <= self.budget_s < math.inf:
            found = f"{self.budget_s:g} s, of which {self.publish_s:g} s to publish"
            raise InputError("shutdown budget", found, "a finite time, and 0 s to all of it to publish")


def nothing_yet(reason: str) -> StoppedError:
    """What a run raises that was stopped before there was anything to keep."""
    name = reason.rpartition(" ")[2]
    return StoppedError(name, int(getattr(signal, name, signal.SIGTERM)))


class Stop:
    """Whether a run is to end early. reason: why, once it is asked for. at_ns: when, ns UTC.

    awaited: set once somebody looks at ``reason``, and will end in good order; before, who asks must end the run.
    """

    def __init__(
        self,
        params: ShutdownParams | None = None,
        clock: Callable[[], float] = time.monotonic,
        utc_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self.reason: str | None = None
        self.at_ns = 0
        self.awaited = False
        self._params, self._clock, self._utc_ns = params or ShutdownParams(), clock, utc_ns
        self._asked_s = math.inf

    def ask(self, reason: str) -> None:
        """End the run; only the first reason counts, and the budget runs from it."""
        if self.reason is None:
            self._asked_s, self.at_ns = self._clock(), self._utc_ns()
            self.reason = reason

    @property
    def left_s(self) -> float:
        """What is left of the budget, 0 or more; infinite while nobody has asked."""
        return max(0.0, self._asked_s + self._params.budget_s - self._clock())

    @property
    def wait_s(self) -> float:
        """What is left for waiting: without what is kept for writing the map."""
        return max(0.0, self.left_s - self._params.publish_s)
