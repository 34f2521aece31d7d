"""The near end of a link: keeps to its radio's bandwidth, measures what gets through, and knows what was lost."""

from __future__ import annotations

import math
import random
import socket
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from pipeline.clock import Clock
from pipeline.errors import ProtocolError
from pipeline.link import handshake
from pipeline.link.backoff import wait_s
from pipeline.link.connections import Connections
from pipeline.link.handshake import Session
from pipeline.link.keys import Endpoint, KeyPair
from pipeline.link.listener import Listener, limit_kernel
from pipeline.link.outgoing import Outgoing
from pipeline.link.params import LinkParams
from pipeline.link.records import record_bytes
from pipeline.link.sockets import shut_down
from pipeline.link.token_bucket import TokenBucket
from pipeline.link.writer import Writer
from pipeline.logs import Log
from pipeline.messages import Message, pack

_LOG = Log("link")


@dataclass(frozen=True)
class LinkState:
    """What is known of a link. rate_bps: what it lets through, measured, at most the declared rate; least_bps: the
    lowest so far. full: whether more is offered than it takes. backlog_s: for what is not known to be read. lost:
    messages whose connection broke before they were known to be read whole. down: connection -> why it is broken or
    silent.
    """

    rate_bps: float
    full: bool
    backlog_s: float
    unread_bytes: int
    lost: int
    down: Mapping[str, str]
    least_bps: float = math.inf


class LinkSender:
    """One radio link, shared by the connections that run over it: one bucket, one thread that writes, one that listens.

    name: of the link, for its logs. keys: who is speaking; its public half must be known at the far ends. bucket: the
    link's declared bandwidth; of an infinite rate for no limit. capacity_bytes: how much of one connection may be
    unread at the far end; a larger message is taken when nothing else is. Messages leave in the order of their sending,
    whatever their connection, in chunks of about 10 ms; what seals them is paid for too. A receiver that does not read
    stops its own connection and no other.

    on_lost(name, reason): a connection is broken, or silent; on_back(name): connected or heard again;
    on_restart(stream, detector): the far end could not take a packet of this substream. All three are called on
    threads of the sender, and must not block. reconnect: whether a broken connection, or one that is expected, is made
    by itself, after the waits of ``params.backoff``; what was not read before is lost, and not sent again.
    """

    def __init__(
        self,
        bucket: TokenBucket,
        *,
        capacity_bytes: int,
        keys: KeyPair,
        name: str = "",
        params: LinkParams | None = None,
        clock: Clock | None = None,
        reconnect: bool = False,
        on_lost: Callable[[str, str], None] = lambda name, reason: None,
        on_back: Callable[[str], None] = lambda name: None,
        on_restart: Callable[[str, str], None] = lambda stream, detector: None,
        chance: Callable[[], float] = random.random,
    ) -> None:
        self._keys, self._capacity_bytes = keys, capacity_bytes
        self._params, self._clock = params or LinkParams(), clock or Clock()
        self._reconnect, self._chance = reconnect, chance
        self._on_lost, self._on_back = on_lost, on_back
        self._connections = Connections(bucket.rate_bps, self._params, self._clock, self._broken)
        self._endpoints: dict[str, Endpoint] = {}
        self._trying: set[str] = set()
        self._writer = Writer(self._connections, bucket)
        runs = {
            "write": self._writer.run,
            "listen": Listener(self._connections, self._silence, on_restart).run,
        }
        self._threads = [
            threading.Thread(target=run, name=f"link {what} {name}", daemon=True)
            for what, run in runs.items()
        ]
        for thread in self._threads:
            thread.start()

    @property
    def bytes_sent(self) -> int:
        """Of messages, on the wire. Heartbeats, 80 bytes a second at most, are paid for and not counted."""
        return self._connections.bytes_sent

    @property
    def lost(self) -> int:
        """Messages whose connection broke before they were known to be read whole."""
        return self._connections.lost

    @property
    def error(self) -> Exception | None:
        """Why a connection broke, if one did and was not connected again."""
        with self._connections.changed:
            return next(iter(self._connections.broken.values()), None)

    def connect(self, name: str, endpoint: Endpoint) -> None:
        """Connect to a receiver, within twice ``params.connect_s``; a broken connection of the name is replaced.

        Raises OSError if nobody listens there; ProtocolError if it is not who it should be, does not know our key, or
        is of another version.
        """
        outgoing = Outgoing(name, *self._open(endpoint), self._clock.monotonic_s())
        shared = self._connections
        with shared.changed:
            if shared.stop.is_set():
                outgoing.socket.close()
                raise ConnectionError(f"link {name!r}: closed")
            former = shared.put(outgoing)
            self._endpoints[name] = endpoint
            limit_kernel(shared, outgoing)
        if former is not None:
            former.socket.close()
        _LOG.event("connected", connection=name, address=endpoint.address)

    def expect(self, name: str, endpoint: Endpoint) -> None:
        """As ``connect``, for a sender that reconnects: what cannot be connected now is broken until it can be."""
        try:
            self.connect(name, endpoint)
        except (OSError, ProtocolError) as error:
            with self._connections.changed:
                self._connections.broken[name] = error
                self._endpoints[name] = endpoint
            self._report(name, str(error))
            self._keep_trying(name)

    def send(self, name: str, message: Message, timeout_s: float | None = None) -> bool:
        """Queue a message; False if there is no room.

        Blocks while there is none, at most timeout_s (None: ``params.send_s``; 0: not at all). Raises
        ConnectionError if the connection is known to be broken, and messages before this one may be lost;
        ProtocolError for a message larger than a receiver takes.
        """
        plain = pack(message)
        nbytes = record_bytes(plain)
        limit_s = self._params.send_s if timeout_s is None else timeout_s
        shared = self._connections
        with shared.changed:
            if not shared.is_usable(name) or not self._has_room(name, nbytes):
                shared.changed.wait_for(
                    lambda: not shared.is_usable(name) or self._has_room(name, nbytes), limit_s
                )
            if not shared.is_usable(name):
                reason = "closed" if shared.stop.is_set() else shared.broken.get(name, "not connected")
                raise ConnectionError(f"link {name!r}: {reason}")
            if not self._has_room(name, nbytes):
                return False
            connection = shared[name]
            connection.offer(shared.next_turn(), plain, message)
        if not self._writer.write_now(connection):
            with shared.changed:
                shared.changed.notify_all()
        return True

    def is_up(self, name: str) -> bool:
        """Whether the connection is neither broken nor silent."""
        with self._connections.changed:
            return self._connections.is_usable(name) and not self._connections[name].silent

    def backlog_s(self) -> float:
        """Seconds that the link, at its measured rate, needs for what is not known to be read at the far end."""
        return self.state().backlog_s

    def state(self) -> LinkState:
        """A snapshot."""
        shared = self._connections
        with shared.changed:
            now_s, unread_bytes = self._clock.monotonic_s(), shared.unread_bytes
            down = {name: str(error) for name, error in shared.broken.items()}
            down |= {c.name: "silent" for c in shared.live if c.silent}
            return LinkState(
                shared.rate.rate_bps(now_s),
                shared.rate.is_full(now_s),
                shared.rate.backlog_s(unread_bytes, now_s),
                unread_bytes,
                shared.lost,
                down,
                shared.rate.least_bps,
            )

    def take_lost(self) -> list[Message]:
        """Messages whose connection broke before they were known to be read whole; each is told once."""
        with self._connections.changed:
            return self._connections.take_lost()

    def flush(self, patience_s: float) -> bool:
        """Wait until all is read at the far end; False once nothing more of it is read for patience_s."""
        shared = self._connections
        with shared.changed:
            while shared.unread_bytes and not shared.stop.is_set():
                if not shared.changed.wait_for(self._is_less_than(shared.unread_bytes), patience_s):
                    return False
            return shared.unread_bytes == 0

    def close(self) -> None:
        """Close all connections; what is still unread is thrown away (flush first)."""
        with self._connections.changed:
            self._connections.stop.set()
            self._connections.changed.notify_all()
        for connection in self._connections.all:
            shut_down(connection.socket)
        for thread in self._threads:
            thread.join(timeout=1.0)
        for connection in self._connections.all:
            connection.socket.close()

    def _open(self, endpoint: Endpoint) -> tuple[socket.socket, Session]:
        connection = socket.create_connection(endpoint.address, timeout=self._params.connect_s)
        try:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            session = handshake.connect(connection, self._keys, endpoint.key, self._params.connect_s)
        except (OSError, ProtocolError):
            connection.close()
            raise
        return connection, session

    def _has_room(self, name: str, nbytes: int) -> bool:
        connection = self._connections[name]
        return not connection.unread or connection.unread_bytes + nbytes <= self._capacity_bytes

    def _is_less_than(self, unread_bytes: int) -> Callable[[], bool]:
        shared = self._connections
        return lambda: shared.stop.is_set() or shared.unread_bytes < unread_bytes

    def _silence(self, name: str, began: bool) -> None:
        if began:
            self._report(name, f"silent for {self._params.silence_s:g} s")
        else:
            _LOG.event("heard again", connection=name)
            self._on_back(name)

    def _broken(self, name: str, error: Exception) -> None:
        shut_down(self._connections[name].socket)
        self._report(name, str(error))
        if self._reconnect:
            self._keep_trying(name)

    def _report(self, name: str, reason: str) -> None:
        _LOG.warning("connection lost", connection=name, reason=reason)
        self._on_lost(name, reason)

    def _keep_trying(self, name: str) -> None:
        with self._connections.changed:
            if name in self._trying:
                return
            self._trying.add(name)
        threading.Thread(target=self._try_again, args=(name,), name="link again", daemon=True).start()

    def _try_again(self, name: str) -> None:
        shared, attempt = self._connections, 0
        while not shared.stop.wait(wait_s(self._params.backoff, attempt, self._chance())):
            attempt += 1
            with shared.changed:
                if name not in shared.broken:  # somebody else has connected it
                    self._trying.discard(name)
                    return
                endpoint = self._endpoints[name]
            try:
                self.connect(name, endpoint)
            except (OSError, ProtocolError) as error:
                with shared.changed:
                    if name in shared.broken:
                        shared.broken[name] = error
                continue
            self._on_back(name)
