"""The mission controller as the supervisor sees it: hosted by the scheduler actor, told and heard, never waited for.

A scheduler that is silent or lost is started again where the one before it was: from a state that it gave, and the log
since then. What it was told and had not answered is told again. Nobody else waits meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from actors.calls import NoAnswerError, get, kill
from actors.live_record import LiveRecord
from actors.scheduler import Heard
from pipeline.allocation.plan import Plan
from pipeline.errors import SearchlightError, in_one_line
from pipeline.mission.controller.events import Event
from pipeline.mission.controller.orders import Say

_NAME = "the scheduler"


class HostedController:
    """new_scheduler: starts an actor. silence_s: one that does not answer for so long is started again. boot_s: as long
    may a new one take. poll_s: after so long it is asked though nothing was heard.
    """

    def __init__(
        self, new_scheduler: Callable[[], Any], silence_s: float, boot_s: float, poll_s: float
    ) -> None:
        self._new, self._silence_s, self._boot_s, self._poll_s = new_scheduler, silence_s, boot_s, poll_s
        self._scheduler = new_scheduler()
        self._untold: list[Event] = []
        self._told: list[Event] = []
        self.question: Any = None
        self._asked_s = 0.0
        self._limit_s = boot_s

    def plan(self) -> Plan:
        """The optimal plan, by the scheduler that goes on to host the controller."""
        plan: Plan = get(self._scheduler.plan.remote(), _NAME)
        return plan

    def begin(self, plan: Plan, record: LiveRecord, now_s: float) -> None:
        """Host the controller from now on, from where the record says it is."""
        self._plan, self._record = plan, record
        self._begin(now_s)

    def tell(self, events: Sequence[Event], now_s: float) -> None:
        """Tell it, at once or with the next question. now_s: of a clock that outlives the scheduler."""
        self._untold += events
        if self.question is None and (self._untold or now_s - self._asked_s >= self._poll_s):
            self._told, self._untold = self._untold, []
            self.question = self._scheduler.hear.remote(tuple(self._told), now_s)
            self._asked_s, self._limit_s = now_s, self._silence_s

    def heard(self, is_answered: bool, now_s: float) -> tuple[Heard | None, Say | None]:
        """Its answer, if ``question`` is answered; what is to be said, if it was lost and is started again."""
        if self.question is None:
            return None, None
        try:
            if not is_answered:
                if now_s - self._asked_s <= self._limit_s:
                    return None, None
                raise NoAnswerError(f"{_NAME} did not answer within {self._limit_s:g} s")
            answer = get(self.question, _NAME, self._limit_s)
        except SearchlightError as error:
            kill(self._scheduler)
            self._scheduler = self._new()
            self._untold, self._told = [*self._told, *self._untold], []
            self._begin(now_s)
            return None, Say("lost", "scheduler", in_one_line(error))
        self.question, self._told = None, []
        return answer, None

    def end(self) -> None:
        """End its process."""
        kill(self._scheduler)

    def _begin(self, now_s: float) -> None:
        record = self._record
        self.question = self._scheduler.begin.remote(self._plan, record.state, tuple(record.log))
        self._asked_s, self._limit_s = now_s, self._boot_s
