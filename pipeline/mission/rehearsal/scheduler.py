"""The model of the scheduler: it hosts the controller, and finds its state again by its log."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import partial

from pipeline.allocation.problem import Problem
from pipeline.mission.controller.controller import step
from pipeline.mission.controller.events import Elapsed, Event, NotSolved, Solved
from pipeline.mission.controller.orders import Order, Solve
from pipeline.mission.controller.params import ControllerParams
from pipeline.mission.controller.recorded import Recorded, replay
from pipeline.mission.controller.state import MissionState, begin
from pipeline.mission.rehearsal.process import Process
from pipeline.mission.rehearsal.timeline import Timeline

ELAPSED_S = 0.1
#: ``step``, or the same with something beside it
Controller = Callable[[MissionState, Event, float], tuple[MissionState, list[Order]]]


class ModelScheduler(Process):
    """solver: gives one answer after the other; the last one is final.

    log: every event with its time, and the orders it gave; on the disk before an order leaves."""

    def __init__(
        self,
        problem: Problem,
        timeline: Timeline,
        solver: Callable[[Solve], Sequence[Solved | NotSolved]],
        carry_out: Callable[[Order], None],
        params: ControllerParams,
        solve_s: Callable[[], float],
        here: Collection[str] | None = None,
        controller: Controller = step,
    ) -> None:
        super().__init__("scheduler", timeline)
        self.log: list[Recorded] = []
        self.state: MissionState = begin(problem, 0.0, params, here)
        self._begin = self.state
        self._controller = controller
        self._solver, self._carry_out, self._solve_s = solver, carry_out, solve_s

    def start(self, incarnation: int) -> None:
        """A new process reads the log."""
        super().start(incarnation)
        self.state = replay(self._begin, self.log)
        if self.state.asked is not None:  # its answer died with the process before
            self.hear(NotSolved(self.state.asked.request, "the scheduler was started again"))
        self.every(ELAPSED_S, lambda: self.hear(Elapsed()))

    def hear(self, event: Event) -> None:
        """Take an event and carry out what follows from it."""
        now = self.timeline.now
        self.state, orders = self._controller(self.state, event, now)
        self.log.append(Recorded(now, event, tuple(orders)))
        for order in orders:
            if isinstance(order, Solve):
                delay_s = 0.0
                for answer in self._solver(order):
                    delay_s += self._solve_s()
                    self.after(delay_s, partial(self.hear, answer))
            else:
                self._carry_out(order)
