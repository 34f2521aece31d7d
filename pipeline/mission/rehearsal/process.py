"""A process that may be killed, stopped for a while, and started again."""

from __future__ import annotations

from collections.abc import Callable

from pipeline.mission.rehearsal.timeline import Timeline


class Process:
    """name: of the actor. incarnation: number of the present process.

    What was put on its agenda dies with it, or waits while it is stopped.
    """

    def __init__(self, name: str, timeline: Timeline) -> None:
        self.name = name
        self.timeline = timeline
        self.incarnation = 0
        self.alive = False
        self._stops = 0
        self._waiting: list[tuple[int, Callable[[], None]]] = []

    @property
    def stopped(self) -> bool:
        """Whether it runs no more, but may go on."""
        return self._stops > 0

    def start(self, incarnation: int) -> None:
        """A new process, without memory."""
        self.incarnation, self.alive, self._stops = incarnation, True, 0
        self._waiting = []

    def kill(self) -> None:
        """The process ends, and what it knew with it."""
        self.alive, self._stops = False, 0
        self._waiting = []

    def stop(self) -> None:
        """It runs no more, but keeps its memory."""
        self._stops += self.alive

    def go_on(self) -> None:
        """Once nobody stops it any more, what should have happened meanwhile happens, in its order."""
        self._stops = max(self._stops - 1, 0)
        if self.stopped:
            return
        waiting, self._waiting = self._waiting, []
        for incarnation, act in waiting:
            self._do(incarnation, act)

    def after(self, delay_s: float, act: Callable[[], None]) -> None:
        """Put something on the agenda of the present process."""
        incarnation = self.incarnation
        self.timeline.after(delay_s, lambda: self._do(incarnation, act))

    def receive(self, act: Callable[[], None]) -> None:
        """Something reaches the process from outside; nobody takes it if there is none."""
        if self.alive:
            self._do(self.incarnation, act)

    def every(self, period_s: float, act: Callable[[], None]) -> None:
        """Do something again and again."""

        def once() -> None:
            act()
            self.after(period_s, once)

        self.after(period_s, once)

    def _do(self, incarnation: int, act: Callable[[], None]) -> None:
        if not self.alive or incarnation != self.incarnation:
            return
        if self.stopped:
            self._waiting.append((incarnation, act))
        else:
            act()
