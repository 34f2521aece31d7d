"""Who was heard of and when, and how far the clocks of nodes are from ours, from what actors say of themselves."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from actors.usage import Usage

#: an actor that was not heard for so long is not up, seconds; the controller notices a loss within as much
UP_S = 2.0
#: of so many of the last words the quickest says what the clocks are apart
_WORDS = 40


class Says(Protocol):
    """A status: a new object with every answer."""

    @property
    def usage(self) -> Usage:
        """Of the process that said it."""


@dataclass
class _Last:
    status: Says
    at_s: float
    delays_s: deque[float] = field(default_factory=lambda: deque(maxlen=_WORDS))


@dataclass
class Heard:
    """Times in seconds since 1970, by our clock."""

    _last: dict[str, _Last] = field(default_factory=dict)

    def take(self, statuses: Mapping[str, Says], utc_s: float) -> None:
        """The newest word of each actor; one that was taken before is no new word."""
        for actor, status in statuses.items():
            last = self._last.get(actor)
            if last is None:
                last = self._last[actor] = _Last(status, utc_s)
            elif last.status is status:
                continue
            last.status, last.at_s = status, utc_s
            last.delays_s.append(utc_s - status.usage.utc_s)

    def last_s(self) -> dict[str, float]:
        """When each actor was heard last."""
        return {actor: last.at_s for actor, last in self._last.items()}

    def is_up(self, actor: str, utc_s: float) -> bool:
        """Whether it was heard a moment ago."""
        return utc_s - self._last[actor].at_s <= UP_S

    def clock_behind_s(self) -> dict[str, float]:
        """By how much the clock of each actor's node seems behind ours; too much by the way of its quickest word."""
        return {actor: min(last.delays_s) for actor, last in self._last.items() if last.delays_s}
