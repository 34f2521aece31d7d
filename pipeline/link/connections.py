"""The connections of one link: what its sender's threads share, under one lock."""

from __future__ import annotations

import threading
from collections.abc import Callable

from pipeline.clock import Clock
from pipeline.link.outgoing import Outgoing
from pipeline.link.params import LinkParams
from pipeline.link.rate_estimate import RateEstimate
from pipeline.messages import Message


class Connections:
    """Hold ``changed`` to read or to change anything; it is notified of every change that somebody may wait for.

    rate: of the link, all connections together. broken: name -> why. lost: messages whose connection broke before they
    were known to be read whole. on_broken(name, error) is called without the lock.
    """

    def __init__(
        self,
        declared_bps: float,
        params: LinkParams,
        clock: Clock,
        on_broken: Callable[[str, Exception], None],
    ) -> None:
        self.params, self.clock = params, clock
        self.changed = threading.Condition()
        self.stop = threading.Event()
        self.rate = RateEstimate(declared_bps, params.rate)
        self.broken: dict[str, Exception] = {}
        self.lost = 0
        self.bytes_sent = 0
        self._on_broken = on_broken
        self._all: dict[str, Outgoing] = {}
        self._unread: list[Message] = []
        self._turn = 0

    def __getitem__(self, name: str) -> Outgoing:
        return self._all[name]

    def put(self, connection: Outgoing) -> Outgoing | None:
        """Take the connection; the one of the same name that it replaces."""
        former = self._all.get(connection.name)
        self._all[connection.name] = connection
        self.broken.pop(connection.name, None)
        return former

    @property
    def all(self) -> list[Outgoing]:
        """Broken ones too."""
        return list(self._all.values())

    @property
    def live(self) -> list[Outgoing]:
        """Those that are not broken."""
        return [c for name, c in self._all.items() if name not in self.broken]

    @property
    def unread_bytes(self) -> int:
        """Offered to connections that are not broken, and not known to be read."""
        return sum(c.unread_bytes for c in self.live)

    def next_turn(self) -> int:
        """Messages leave in the order of these numbers."""
        self._turn += 1
        return self._turn

    def is_usable(self, name: str) -> bool:
        """Whether anything can be sent there."""
        return not self.stop.is_set() and name in self._all and name not in self.broken

    def tell_rate(self) -> None:
        """Whether the link is full. A receiver that has stopped says nothing about the link, unless all have."""
        live = self.live
        heard = [c for c in live if not c.silent] or live
        now_s = self.clock.monotonic_s()
        if any(c.blocked for c in heard):
            self.rate.blocked(now_s)
        else:
            self.rate.free(now_s)

    def take_lost(self) -> list[Message]:
        """The lost messages, each once."""
        lost, self._unread = self._unread, []
        return lost

    def give_up(self, connection: Outgoing, error: Exception) -> None:
        """A connection is broken; call it without the lock. Nothing, if it is known or was replaced."""
        with self.changed:
            if not self.is_usable(connection.name) or self._all[connection.name] is not connection:
                return
            self.broken[connection.name] = error
            self.lost += len(connection.unread)
            self._unread += connection.unread
            self.changed.notify_all()
        self._on_broken(connection.name, error)
