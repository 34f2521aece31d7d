"""When the pictures of a live stream were taken: from presentation times to seconds since the stream's zero."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from statistics import median
from typing import Literal

#: what a capture time rests on: RTCP's NTP times, the stamps of KLV, or the moment of arrival
Basis = Literal["ntp", "klv", "arrival"]


@dataclass(frozen=True)
class CaptureClockParams:
    """Seconds. most_off_s: what a stream's clock says was taken so long before it arrived is not believed. early_s: nor
    what was taken after it arrived, but for so much. window_s: of arrivals, of which the one that was least on its way
    tells the delay. back_s: a presentation time that goes back by more is of a sender that began anew. references: of
    so many of the newest the median counts.
    """

    most_off_s: float = 10.0
    early_s: float = 0.25
    window_s: float = 5.0
    back_s: float = 1.0
    references: int = 25


@dataclass
class CaptureClock:
    """Of one stream, over its connections. All times are seconds; arrivals and results count from one zero, which is a
    moment of our UTC clock; presentation times from whatever the sender counts from.

    A reference says when what is presented at a time was taken, by the sender's clock. Without one, a picture was taken
    when it would have arrived with the least delay of the last seconds: late by that delay, which nobody knows.
    refused: how far a clock is off that was not believed, else 0.
    """

    params: CaptureClockParams = field(default_factory=CaptureClockParams)
    believes: bool = True
    refused_s: float = 0.0

    def __post_init__(self) -> None:
        self._offsets: deque[tuple[float, float]] = deque()  # (arrival, arrival less presentation time)
        self._said: dict[Basis, deque[float]] = {"ntp": deque(), "klv": deque()}
        self._last: tuple[float, float] | None = None

    @property
    def basis(self) -> Basis:
        """What the next time will rest on."""
        return next((basis for basis, said in self._said.items() if said), "arrival")

    def restart(self) -> None:
        """The sender counts anew: a new connection."""
        self._offsets.clear()
        for said in self._said.values():
            said.clear()
        self._last = None

    def heard(self, shown_s: float, arrival_s: float) -> None:
        """Something presented at a time has come."""
        if self._last is not None and shown_s < self._last[0] - self.params.back_s:
            self.restart()
        self._last = (max(shown_s, self._last[0]) if self._last else shown_s), arrival_s
        self._offsets.append((arrival_s, arrival_s - shown_s))
        while self._offsets[0][0] < arrival_s - self.params.window_s:
            self._offsets.popleft()

    def refer(self, basis: Basis, shown_s: float, taken_s: float, arrival_s: float) -> None:
        """What is presented at shown_s was taken at taken_s, by the sender's clock."""
        off_s = taken_s - arrival_s
        if not math.isfinite(off_s):
            return
        if not self.believes or not -self.params.most_off_s <= off_s <= self.params.early_s:
            self.refused_s = off_s if self.believes else self.refused_s
            self._said[basis].clear()
            return
        said = self._said[basis]
        said.append(taken_s - shown_s)
        while len(said) > self.params.references:
            said.popleft()

    def taken_s(self, shown_s: float) -> float:
        """When what is presented at a time was taken. NaN before anything was heard."""
        said = self._said.get(self.basis)
        if said:
            return shown_s + median(said)
        if not self._offsets:
            return math.nan
        return shown_s + min(offset for _, offset in self._offsets)
