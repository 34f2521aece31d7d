"""What the real controller costs: a rehearsal without faults, in which every step is timed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from pipeline.mission.controller.controller import step
from pipeline.mission.controller.events import Event
from pipeline.mission.controller.orders import Order
from pipeline.mission.controller.state import MissionState
from pipeline.mission.load.inventory import load_problem, planned
from pipeline.mission.rehearsal.rehearse import NetworkParams, Rehearsal

#: nothing is lost, and all starts within a second
_CALM = NetworkParams(delay_s=(0.001, 0.02), loss=0.0, boot_s=(0.1, 0.2), load_s=(0.1, 0.3), unanswered=0.0)
_FOR_EVER = 10**9
_LOOK_S = 0.05


@dataclass
class TimedSteps:
    """The controller's step, timed. clock: seconds of processor."""

    clock: Callable[[], float]
    steps: int = 0
    seconds: float = 0.0

    def __call__(self, state: MissionState, event: Event, now: float) -> tuple[MissionState, list[Order]]:
        """As ``step``."""
        begun = self.clock()
        try:
            return step(state, event, now)
        finally:
            self.seconds += self.clock() - begun
            self.steps += 1


@dataclass(frozen=True)
class ControllerLoad:
    """Of a second of the mission, once all streams fly: steps; cores, seconds of processor; results that machines send.

    flying: streams that follow a plan. watched_s: of the mission; 0: not all of them flew within the time there was.
    """

    streams: int
    sites: int
    flying: int
    watched_s: float
    steps: float = math.nan
    cores: float = math.nan
    results: float = math.nan


class _Watched(Rehearsal):
    """Is over once it was watched for so long after every stream has followed a plan, or there is no more time."""

    def watch(self, timed: TimedSteps, seconds: float, limit_s: float) -> None:
        """seconds: of the mission. limit_s: of the clock, in all."""
        self._timed, self._seconds, self._until_s = timed, seconds, timed.clock() + limit_s
        self._look_s, self._begun_s, self._before = 0.0, math.inf, self._counted

    @property
    def _counted(self) -> tuple[int, float, int]:
        sent = sum(len(source.sent) for source in self.sources.values())
        return self._timed.steps, self._timed.seconds, sent

    @property
    def flying(self) -> int:
        """Streams that have followed a plan."""
        return sum(bool(source.followed) for source in self.sources.values())

    @property
    def is_over(self) -> bool:
        """See the class."""
        now_s = self.timeline.now
        if now_s >= self._look_s:
            self._look_s = now_s + _LOOK_S
            if math.isinf(self._begun_s) and self.flying == len(self.sources):
                self._begun_s, self._before = now_s, self._counted
        return now_s > self._begun_s + self._seconds or self._timed.clock() > self._until_s

    @property
    def per_second(self) -> tuple[float, float, float, float]:
        """Seconds watched; steps, seconds of the clock and frames sent in each of them."""
        watched_s = max(0.0, self.timeline.now - self._begun_s)
        if watched_s == 0.0:
            return 0.0, math.nan, math.nan, math.nan
        steps, spent, sent = (
            (after - before) / watched_s for after, before in zip(self._counted, self._before, strict=True)
        )
        return watched_s, steps, spent, sent


def controller_load(
    streams: int, sites: int, seconds: float, limit_s: float, clock: Callable[[], float]
) -> ControllerLoad:
    """seconds: of the mission that are watched. limit_s: of the clock, which counts seconds of processor."""
    timed = TimedSteps(clock)
    rehearsal = _Watched(
        load_problem(streams, sites), planned, ticks=_FOR_EVER, network=_CALM, controller=timed
    )
    rehearsal.watch(timed, seconds, limit_s)
    rehearsal.run(math.inf)
    watched_s, steps, cores, results = rehearsal.per_second
    return ControllerLoad(streams, sites, rehearsal.flying, watched_s, steps, cores, results)
