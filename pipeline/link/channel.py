"""Messages over TCP between sites.

A sender that keeps to its radio's bandwidth, and a receiver that can hold it up.
"""

from __future__ import annotations

import math
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress

from pipeline.errors import ProtocolError
from pipeline.link import handshake
from pipeline.link.framing import FrameReader, frame
from pipeline.link.token_bucket import TokenBucket
from pipeline.messages import MAX_MESSAGE_BYTES, Message, pack, unpack

Address = tuple[str, int]
_CONNECT_TIMEOUT_S = 5.0
_READ_BYTES = 256 * 1024
_CHUNK_S = 0.01
_CHUNK_BYTES = (1024, 64 * 1024)


class Receiver:
    """Listens; hands each message to on_message, in the order of its connection, on that connection's thread.

    on_message may block: then its sender is held up, since nothing is read meanwhile. If it raises, the
    connection is closed and the exception kept in ``error``. A peer without the token or with bytes that
    are no message loses its connection and is counted in ``rejected``.
    """

    def __init__(
        self, host: str, on_message: Callable[[Message], None], *, token: bytes, port: int = 0
    ) -> None:
        self.rejected = 0
        self.error: Exception | None = None
        self._on_message, self._token = on_message, token
        self._lock = threading.Lock()
        self._connections: dict[threading.Thread, socket.socket] = {}
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._listener = socket.create_server((host, port), family=family)
        self.address: Address = self._listener.getsockname()[:2]
        self._closed = False
        threading.Thread(target=self._accept, name=f"link accept {self.address[1]}", daemon=True).start()

    def close(self) -> None:
        """Stop listening, close all connections; a message in on_message is waited for, at most a second."""
        with self._lock:
            self._closed = True
            connections = dict(self._connections)
        for endpoint in (self._listener, *connections.values()):
            _shut_down(endpoint)
        self._listener.close()
        for thread in connections:
            if thread is not threading.current_thread():
                thread.join(timeout=1.0)

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:  # close()
                return
            thread = threading.Thread(
                target=self._serve, args=(connection,), name="link receive", daemon=True
            )
            with self._lock:
                if self._closed:
                    connection.close()
                    return
                self._connections[thread] = connection
            thread.start()

    def _serve(self, connection: socket.socket) -> None:
        try:
            handshake.accept(connection, self._token)
            for message in _messages(connection):
                if not self._deliver(message):
                    return
        except ProtocolError:
            with self._lock:
                self.rejected += 1
        except OSError:  # the peer is gone, or close(); what is missing is for the mission to notice
            pass
        finally:
            with self._lock:
                self._connections.pop(threading.current_thread(), None)
            connection.close()

    def _deliver(self, message: Message) -> bool:
        try:
            self._on_message(message)
        except Exception as error:
            self.error = error
            return False
        return True


class LinkSender:
    """One radio link, shared by the connections that run over it: one queue, one thread, one bucket.

    bucket: the link's bandwidth; of an infinite rate for no limit. capacity_bytes: how much may wait; a
    larger message is taken when nothing else waits. clock, sleep: seconds. Messages leave in the order of
    their sending, whatever their connection, in chunks of about 10 ms; their length prefixes are paid for
    too. A receiver that does not read holds up the whole link. ``bytes_sent``: on the wire. ``lost``:
    messages taken by send whose connection broke before all of their bytes were written.
    """

    def __init__(
        self,
        bucket: TokenBucket,
        *,
        capacity_bytes: int,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.bytes_sent = 0
        self.lost = 0
        self._bucket, self._capacity_bytes = bucket, capacity_bytes
        self._clock, self._sleep = clock, sleep
        self._chunk_bytes = _chunk_bytes(bucket)
        self._connections: dict[str, socket.socket] = {}
        self._broken: dict[str, OSError] = {}
        self._queue: deque[tuple[str, socket.socket, bytes]] = deque()
        self._waiting_bytes = 0  # of the queue and of the message on its way
        self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._drain, name="link send", daemon=True)
        self._thread.start()

    @property
    def error(self) -> OSError | None:
        """Why a connection broke, if one did and was not connected again."""
        return next(iter(self._broken.values()), None)

    def connect(self, name: str, address: Address, token: bytes) -> None:
        """Connect to a receiver; a broken connection of the name is replaced.

        Raises OSError if nobody listens there, ProtocolError if the token is not theirs.
        """
        connection = socket.create_connection(address, timeout=_CONNECT_TIMEOUT_S)
        try:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            handshake.connect(connection, token)
        except (OSError, ProtocolError):
            connection.close()
            raise
        with self._changed:
            former = self._connections.get(name)
            self._connections[name] = connection
            self._broken.pop(name, None)
        if former is not None:
            former.close()

    def send(self, name: str, message: Message, timeout_s: float | None = None) -> bool:
        """Queue a message; False if there is no room.

        Blocks while the queue is full, at most timeout_s (None: for ever; 0: not at all). Raises
        ConnectionError if the connection is known to be broken, and messages before this one may be lost;
        ProtocolError for a message larger than a receiver takes.
        """
        data = frame(pack(message))
        with self._changed:
            self._changed.wait_for(lambda: self._unusable(name) or self._has_room(len(data)), timeout_s)
            if self._unusable(name):
                reason = "closed" if self._closed else self._broken.get(name, "not connected")
                raise ConnectionError(f"link {name!r}: {reason}")
            if not self._has_room(len(data)):
                return False
            self._queue.append((name, self._connections[name], data))
            self._waiting_bytes += len(data)
            self._changed.notify_all()
        return True

    def backlog_s(self) -> float:
        """Seconds of link time that what waits will take."""
        on_its_way_s = self._bucket.backlog_s(self._clock())
        return self._waiting_bytes * 8.0 / self._bucket.rate_bps + on_its_way_s

    def flush(self, timeout_s: float | None = None) -> bool:
        """Wait until nothing waits; False if the time is up before."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting_bytes == 0 or self._closed, timeout_s)
            return self._waiting_bytes == 0

    def close(self) -> None:
        """Close all connections; what still waits is thrown away (flush first)."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        for connection in self._connections.values():
            _shut_down(connection)
        self._thread.join(timeout=1.0)
        for connection in self._connections.values():
            connection.close()

    def _unusable(self, name: str) -> bool:
        return self._closed or name in self._broken or name not in self._connections

    def _has_room(self, nbytes: int) -> bool:
        return self._waiting_bytes == 0 or self._waiting_bytes + nbytes <= self._capacity_bytes

    def _drain(self) -> None:
        while (item := self._next()) is not None:
            name, connection, data = item
            error = None
            try:
                _require_open(connection)
                self._transmit(connection, data)
            except OSError as caught:
                error = caught
            with self._changed:
                self._waiting_bytes -= len(data)
                if error is not None:
                    self.lost += 1
                    if self._connections[name] is connection:
                        self._broken.setdefault(name, error)
                self._changed.notify_all()

    def _next(self) -> tuple[str, socket.socket, bytes] | None:
        with self._changed:
            self._changed.wait_for(lambda: self._queue or self._closed)
            return None if self._closed else self._queue.popleft()

    def _transmit(self, connection: socket.socket, data: bytes) -> None:
        view = memoryview(data)
        for start in range(0, len(data), self._chunk_bytes):
            chunk = view[start : start + self._chunk_bytes]
            now_s = self._clock()
            delay_s = self._bucket.reserve(len(chunk), now_s) - now_s
            if delay_s > 0.0:
                self._sleep(delay_s)
            connection.sendall(chunk)
            self.bytes_sent += len(chunk)


def _messages(connection: socket.socket) -> Iterator[Message]:
    reader = FrameReader()
    while data := connection.recv(_READ_BYTES):
        for message in reader.feed(data):
            yield unpack(message)


def _chunk_bytes(bucket: TokenBucket) -> int:
    """About 10 ms of the link, within reason and what the bucket holds; all if it has no limit."""
    if math.isinf(bucket.rate_bps):
        return MAX_MESSAGE_BYTES
    low, high = _CHUNK_BYTES
    wanted = min(max(bucket.rate_bps / 8.0 * _CHUNK_S, low), high)
    return max(1, int(min(wanted, bucket.burst_bytes)))


def _require_open(connection: socket.socket) -> None:
    """Raises OSError if the receiver has closed the connection; a write would succeed once more."""
    try:
        # a receiver never sends: there is nothing to read but the end
        connection.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT)
    except BlockingIOError:
        return
    raise ConnectionResetError("closed by the receiver")


def _shut_down(endpoint: socket.socket) -> None:
    """Wake whoever blocks on a socket; closing it alone would not."""
    with suppress(OSError):  # not connected any more
        endpoint.shutdown(socket.SHUT_RDWR)
