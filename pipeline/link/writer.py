"""The thread of a link that writes: what waits, at the bucket's pace, as far as the kernels take it."""

from __future__ import annotations

import math
import select
import socket
import threading

from pipeline.link.connections import Connections
from pipeline.link.outgoing import Outgoing
from pipeline.link.token_bucket import TokenBucket
from pipeline.messages import MAX_MESSAGE_BYTES

_CHUNK_S = 0.01
_CHUNK_BYTES = (1024, 64 * 1024)
_POLL_S = 0.02


class Writer:
    """Messages leave in the order of their turns; a connection whose kernel takes no more stops no other.

    Over a link without a limit, where nothing has to be waited for, whoever sends writes by itself (``write_now``): to
    wake another thread for it takes longer than the writing.
    """

    def __init__(self, connections: Connections, bucket: TokenBucket) -> None:
        self._connections, self._bucket = connections, bucket
        self._clock = connections.clock
        self._chunk_bytes = _chunk_bytes(bucket)
        self._unlimited = math.isinf(bucket.rate_bps)
        self._writing = threading.Lock()

    def run(self) -> None:
        """Until the link is closed."""
        while (connection := self._next()) is not None:
            with self._writing:
                if connection.turn is not None:  # nobody else has written it meanwhile
                    self._write(connection)

    def write_now(self, connection: Outgoing) -> bool:
        """Write what waits for a connection on the caller's thread; False if somebody has to go on with it."""
        if not self._unlimited:
            return False
        with self._writing:  # never for long: no write waits
            while connection.turn is not None and not connection.blocked:
                if not self._write(connection):
                    return True
            return connection.turn is None

    def _next(self) -> Outgoing | None:
        """The connection whose message has waited longest, of those whose kernel takes something; None at the end."""
        shared = self._connections
        while not shared.stop.is_set():
            with shared.changed:
                shared.changed.wait_for(lambda: shared.stop.is_set() or any(c.turn for c in shared.live))
                waiting = [c for c in shared.live if c.turn]
            self._unblock(waiting)
            ready = [(c.turn or 0, c) for c in waiting if not c.blocked]
            if ready:
                return min(ready, key=lambda pair: pair[0])[1]
        return None

    def _unblock(self, waiting: list[Outgoing]) -> None:
        blocked = {c.socket.fileno(): c for c in waiting if c.blocked}
        if not blocked:
            return
        poll = select.poll()
        for descriptor in blocked:
            if descriptor >= 0:
                poll.register(descriptor, select.POLLOUT)
        # with others to write for, only a look; else a wait, short since others may come
        events = poll.poll(0 if len(blocked) < len(waiting) else _POLL_S * 1e3)
        with self._connections.changed:
            for descriptor, _ in events:
                blocked[descriptor].blocked = False
            self._connections.tell_rate()

    def _write(self, connection: Outgoing) -> bool:
        """A chunk; False if the connection is broken."""
        chunk = connection.chunk(self._chunk_bytes)
        self._pay(connection, len(chunk))
        shared = self._connections
        try:
            with shared.changed:  # the far end may answer before the bytes are booked; a send never waits
                taken = _take(connection.socket, chunk)
                was, connection.blocked = connection.blocked, taken < len(chunk)
                shared.bytes_sent += connection.wrote(taken, self._clock.monotonic_s())
                if was or connection.blocked:
                    shared.tell_rate()
        except OSError as error:
            shared.give_up(connection, error)
            return False
        return True

    def _pay(self, connection: Outgoing, nbytes: int) -> None:
        """Wait until the bucket has the bytes, but for those that were paid for and not taken by the kernel."""
        owed = nbytes - connection.paid_bytes
        if owed <= 0 or self._unlimited:
            return
        now_s = self._clock.monotonic_s()
        delay_s = self._bucket.reserve(owed, now_s) - now_s
        connection.paid_bytes += owed
        if delay_s > 0.0:
            self._clock.sleep(delay_s)


def _take(connection: socket.socket, data: memoryview) -> int:
    """How many of the bytes the kernel takes at once."""
    try:
        return connection.send(data, socket.MSG_DONTWAIT)
    except BlockingIOError:
        return 0


def _chunk_bytes(bucket: TokenBucket) -> int:
    """About 10 ms of the link, within reason and what the bucket holds; all if it has no limit."""
    if math.isinf(bucket.rate_bps):
        return MAX_MESSAGE_BYTES
    low, high = _CHUNK_BYTES
    wanted = min(max(bucket.rate_bps / 8.0 * _CHUNK_S, low), high)
    return max(1, int(min(wanted, bucket.burst_bytes)))
