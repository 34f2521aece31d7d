"""A radio link of one stream to one site: first in, first out, at the rate of the moment."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from pipeline.mission.rehearsal.packets import SentEnd, SentFrame
from pipeline.mission.rehearsal.timeline import Timeline

_RETRY_S = 0.05


class ModelLink:
    """rate_bps: what it lets through now; 0: it is down. carried_bits: so far."""

    def __init__(
        self, timeline: Timeline, rate_bps: float, deliver: Callable[[SentFrame | SentEnd], None]
    ) -> None:
        self.rate_bps = rate_bps
        self.carried_bits = 0.0
        self._timeline, self._deliver = timeline, deliver
        self._queue: deque[SentFrame | SentEnd] = deque()
        self._round = 0
        self._busy = False

    @property
    def waiting_bits(self) -> float:
        """What is not at the other end yet."""
        return sum(message.bits for message in self._queue)

    def send(self, message: SentFrame | SentEnd) -> None:
        """Take a message."""
        self._queue.append(message)
        self._pump()

    def cut(self) -> None:
        """Lose what is on its way."""
        self._queue.clear()
        self._round += 1
        self._busy = False

    def _pump(self) -> None:
        if self._busy or not self._queue:
            return
        self._busy = True
        this_round = self._round
        if self.rate_bps <= 0.0:
            self._timeline.after(_RETRY_S, lambda: self._again(this_round))
        else:
            delay_s = self._queue[0].bits / self.rate_bps
            self._timeline.after(delay_s, lambda: self._arrive(this_round))

    def _again(self, of_round: int) -> None:
        if of_round == self._round:
            self._busy = False
            self._pump()

    def _arrive(self, of_round: int) -> None:
        if of_round != self._round:
            return
        self._busy = False
        if self.rate_bps > 0.0:
            message = self._queue.popleft()
            self.carried_bits += message.bits
            self._deliver(message)
        self._pump()
