"""The thread of a link that writes: what waits, at the bucket's pace, as far as the kernels take it."""

from __future__ import annotations

import math
import select
import socket

from pipeline.link.connections import Connections
from pipeline.link.outgoing import Outgoing
from pipeline.link.token_bucket import TokenBucket
from pipeline.messages import MAX_MESSAGE_BYTES

_CHUNK_S = 0.01
_CHUNK_BYTES = (1024, 64 * 1024)
_POLL_S = 0.02


class Writer:
    """Messages leave in the order of their turns; a connection whose kernel takes no more stops no other."""

    def __init__(self, connections: Connections, bucket: TokenBucket) -> None:
        self._connections, self._bucket = connections, bucket
        self._clock = connections.clock
        self._chunk_bytes = _chunk_bytes(bucket)

    def run(self) -> None:
        """Until the link is closed."""
        while (connection := self._next()) is not None:
            self._write(connection)

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

    def _write(self, connection: Outgoing) -> None:
        chunk = connection.chunk(self._chunk_bytes)
        self._pay(connection, len(chunk))
        shared = self._connections
        try:
            with shared.changed:  # the far end may answer before the bytes are booked; a send never waits
                taken = _take(connection.socket, chunk)
                connection.blocked = taken < len(chunk)
                shared.bytes_sent += connection.wrote(taken, self._clock.monotonic_s())
                shared.tell_rate()
        except OSError as error:
            shared.give_up(connection, error)

    def _pay(self, connection: Outgoing, nbytes: int) -> None:
        """Wait until the bucket has the bytes, but for those that were paid for and not taken by the kernel."""
        owed = nbytes - connection.paid_bytes
        if owed <= 0:
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
