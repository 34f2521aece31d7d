"""The scheduler actor: it plans, and as long as the mission lasts it hosts the mission controller."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pipeline.allocation.plan import Plan
from pipeline.errors import failure
from pipeline.mission.controller.controller import step
from pipeline.mission.controller.events import Elapsed, Event, NotSolved, Solved
from pipeline.mission.controller.orders import Solve
from pipeline.mission.controller.recorded import Recorded, replay
from pipeline.mission.controller.state import MissionState
from pipeline.mission.planning import plan
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.solving import answers

#: share of a plan's accuracy that may be given up to move fewer substreams
_LOSS = 0.02
#: events between two states that are given: what came before them need not be kept
_STATE_EVERY = 500


@dataclass(frozen=True)
class Heard:
    """What was taken and ordered. all_planned: every stream has an epoch to follow, or is known to have none.

    state: after all that, now and then; a next scheduler can go on from there.
    """

    recorded: tuple[Recorded, ...]
    all_planned: bool
    state: MissionState | None = None


class SchedulerActor:
    """Plans for one mission. Answers of the solver come with the next call of ``hear``."""

    def __init__(self, prepared: PreparedMission) -> None:
        self._prepared = prepared
        self._priorities = {stream.id: stream.priority for stream in prepared.mission.streams}
        self._first: Plan | None = None
        self._state: MissionState | None = None
        self._since_state = 0
        self._answers: queue.Queue[Solved | NotSolved] = queue.Queue()

    def plan(self) -> Plan:
        """The optimal plan. Raises NoPlanError if there is none."""
        return plan(self._prepared)

    def begin(self, first: Plan, state: MissionState, log: Sequence[Recorded]) -> None:
        """Host the controller from now on. first: the plan of the whole inventory. state, log: where a scheduler before
        this one was, and what it has heard since.
        """
        self._first = first
        self._state = replay(state, log)
        self._since_state = len(log)
        if self._state.asked is not None:  # its answer died with the process before
            self._answers.put(NotSolved(self._state.asked.request, "the scheduler was started again"))

    def hear(self, events: Iterable[Event], now_s: float) -> Heard:
        """Take events, and what the solver has found since. now_s: of the caller's clock, which outlives this actor."""
        assert self._state is not None, "begin comes first"
        recorded = []
        for event in (*events, *self._found(), Elapsed()):
            self._state, orders = step(self._state, event, now_s)
            recorded.append(Recorded(now_s, event, tuple(orders)))
            for order in orders:
                if isinstance(order, Solve):
                    threading.Thread(target=self._solve, args=(order,), daemon=True).start()
        all_planned = all(s.given or s.unserved for s in self._state.streams.values())
        return Heard(tuple(recorded), all_planned, self._state_if_due(len(recorded)))

    def _state_if_due(self, more: int) -> MissionState | None:
        self._since_state += more
        if self._since_state < _STATE_EVERY:
            return None
        self._since_state = 0
        return self._state

    def _found(self) -> Iterable[Solved | NotSolved]:
        while not self._answers.empty():
            yield self._answers.get()

    def _solve(self, question: Solve) -> None:
        try:
            if (
                self._first is not None
                and question.problem == self._prepared.problem
                and not question.running
            ):
                self._answers.put(Solved(question.request, self._first.assignments))
                return
            for answer in answers(question, priorities=self._priorities, loss=_LOSS):
                self._answers.put(answer)
        except Exception as error:
            self._answers.put(NotSolved(question.request, str(failure(error)).splitlines()[0]))
