"""The door of a receiver: takes connections and hands on those that have proven who they are.

One thread does it all without waiting for anybody, so a connection that says nothing costs a descriptor and some
hundred bytes, for a limited time. There are few places before the door: where they are full, the one who has waited
longest goes, of the address that has taken most of them. No descriptor left is no end: somebody who waits is sent away
for it, or one that was kept in reserve is used.
"""

from __future__ import annotations

import errno
import os
import selectors
import socket
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial

from pipeline.errors import ProtocolError
from pipeline.link.handshake import HELLO, Greeting, Session
from pipeline.link.params import LinkParams

#: so often those that wait are looked at
_LOOK_S = 0.05
#: accept() says so where the process or the system has no room for another connection
_NO_ROOM = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM})


@dataclass(eq=False)
class _Waiting:
    """A connection before the door. until_s: monotonic."""

    socket: socket.socket
    host: str
    greeting: Greeting
    until_s: float


@dataclass(frozen=True)
class Guest:
    """A connection that has proven whose it is."""

    socket: socket.socket
    name: str
    key: bytes
    session: Session


@dataclass
class _Reserve:
    """Descriptors that are held for times when there are no others."""

    most: int
    held: list[int] = field(default_factory=list)

    def fill(self) -> None:
        with suppress(OSError):
            while len(self.held) < self.most:
                self.held.append(os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC))

    def release(self) -> bool:
        """Let one go; whether there was one."""
        if self.held:
            os.close(self.held.pop())
            return True
        return False

    def close(self) -> None:
        while self.release():
            pass


class Door:
    """greeting(): a new one for each connection. on_guest(guest): takes the connection over.

    on_refused(reason, text): of one that was sent away. Both are called on the door's thread.
    """

    def __init__(
        self,
        listener: socket.socket,
        params: LinkParams,
        greeting: Callable[[], Greeting],
        on_guest: Callable[[Guest], None],
        on_refused: Callable[[str, str], None],
    ) -> None:
        self._listener, self._params, self._greeting = listener, params, greeting
        self._on_guest, self._on_refused = on_guest, on_refused
        self._waiting: list[_Waiting] = []
        self._reserve = _Reserve(params.reserve_descriptors)
        self._selector = selectors.DefaultSelector()
        listener.setblocking(False)

    def run(self, is_closed: Callable[[], bool]) -> None:
        """Until it is closed, and the listening socket was shut down so that this is noticed at once."""
        self._reserve.fill()
        self._selector.register(self._listener, selectors.EVENT_READ)
        try:
            while not is_closed():
                self._look(is_closed)
        finally:
            self._selector.close()
            self._reserve.close()
            for waiting in self._waiting:
                waiting.socket.close()

    def _look(self, is_closed: Callable[[], bool]) -> None:
        events = self._selector.select(_LOOK_S if self._waiting else 1.0)
        for key, _ in events:
            if key.data is not None and key.data in self._waiting:
                self._hear(key.data)
        if any(key.data is None for key, _ in events) and not is_closed():
            self._let_in()
        now_s = time.monotonic()
        for waiting in tuple(self._waiting):
            if waiting.until_s <= now_s:
                stranger = bool(waiting.greeting.key) and waiting.greeting.name is None
                self._refuse(
                    waiting, "unknown_key" if stranger else "silent", "did not prove its key in time"
                )
            else:
                self._answer(waiting, waiting.greeting.look_again)

    def _let_in(self) -> None:
        """Those that knock, at once as many as half of the places: who comes next must be heard before it has to go."""
        places, taken = self._params.most_greeted, 0
        while taken < max(1, places // 2):
            try:
                connection, address = self._listener.accept()
            except BlockingIOError:
                return
            except OSError as error:
                places = min(places, self._reserve.most)
                if error.errno not in _NO_ROOM or not (self._reserve.release() or self._make_room()):
                    time.sleep(_LOOK_S)  # it broke while it knocked, or there is no room at all: no busy loop
                    return
                continue
            taken += 1
            if len(self._waiting) >= self._params.most_greeted:
                self._make_room()
            self._reserve.fill()
            self._greet(connection, str(address[0]))

    def _greet(self, connection: socket.socket, host: str) -> None:
        connection.setblocking(False)
        until_s = time.monotonic() + self._params.connect_s
        waiting = _Waiting(connection, host, self._greeting(), until_s)
        self._waiting.append(waiting)
        self._selector.register(connection, selectors.EVENT_READ, waiting)
        self._answer(waiting, lambda: HELLO)

    def _make_room(self) -> bool:
        """Send one away; False if there is nobody. Who has shown a key that is known stays."""
        may_go = [w for w in self._waiting if w.greeting.name is None] or self._waiting
        if not may_go:
            return False
        held = Counter(waiting.host for waiting in may_go)
        most = max(held.values())
        self._refuse(next(w for w in may_go if held[w.host] == most), "crowded", "made room for another")
        return True

    def _hear(self, waiting: _Waiting) -> None:
        """All that it has said; of a stranger no more than its key."""
        while waiting in self._waiting:
            wanted = waiting.greeting.wanted_bytes
            if not wanted:
                with suppress(KeyError):
                    self._selector.unregister(waiting.socket)
                return
            try:
                data = waiting.socket.recv(wanted)
            except BlockingIOError:
                return
            except OSError as error:
                self._refuse(waiting, "went_away", error.strerror or str(error))
                return
            if not data:
                self._refuse(waiting, "went_away", "closed before it had proven its key")
                return
            self._answer(waiting, partial(waiting.greeting.take, data))

    def _answer(self, waiting: _Waiting, say: Callable[[], bytes]) -> None:
        """Say what is to be said, and let in whoever is done."""
        try:
            answer = say()
            if answer and waiting.socket.send(answer) < len(answer):
                raise OSError("it does not read")
        except ProtocolError as error:
            self._refuse(waiting, error.reason, str(error))
            return
        except OSError as error:
            self._refuse(waiting, "went_away", error.strerror or str(error))
            return
        greeting = waiting.greeting
        if greeting.session is not None:
            self._forget(waiting)
            waiting.socket.setblocking(True)
            assert greeting.name is not None
            self._on_guest(Guest(waiting.socket, greeting.name, greeting.key, greeting.session))
        elif answer and greeting.wanted_bytes:  # a stranger no more
            with suppress(KeyError):
                self._selector.register(waiting.socket, selectors.EVENT_READ, waiting)

    def _refuse(self, waiting: _Waiting, reason: str, text: str) -> None:
        self._forget(waiting)
        waiting.socket.close()
        self._on_refused(reason, text)

    def _forget(self, waiting: _Waiting) -> None:
        self._waiting.remove(waiting)
        with suppress(KeyError):
            self._selector.unregister(waiting.socket)
