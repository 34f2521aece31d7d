"""The thread of a link that listens: what the far ends have read, whether they are alive, what they ask for."""

from __future__ import annotations

import math
import select
import socket
from collections.abc import Callable

from pipeline.errors import ProtocolError
from pipeline.link.connections import Connections
from pipeline.link.feedback import Read
from pipeline.link.outgoing import Outgoing
from pipeline.link.sockets import hold_at_most

_POLL_S = 0.02
_READ_BYTES = 64 * 1024


class Listener:
    """on_silence(name, whether it began or ended), on_restart(stream, detector): called without the lock."""

    def __init__(
        self,
        connections: Connections,
        on_silence: Callable[[str, bool], None],
        on_restart: Callable[[str, str], None],
    ) -> None:
        self._connections = connections
        self._clock, self._params = connections.clock, connections.params
        self._on_silence, self._on_restart = on_silence, on_restart

    def run(self) -> None:
        """Until the link is closed."""
        while not self._connections.stop.is_set():
            with self._connections.changed:
                live = {c.socket.fileno(): c for c in self._connections.live}
            poll = select.poll()
            for descriptor in live:
                if descriptor >= 0:
                    poll.register(descriptor, select.POLLIN)
            for descriptor, _ in poll.poll(min(_POLL_S, self._params.heartbeat_s) * 1e3):
                self._hear(live[descriptor])
            for connection in live.values():
                self._keep(connection)

    def _hear(self, connection: Outgoing) -> None:
        try:
            data = connection.socket.recv(_READ_BYTES, socket.MSG_DONTWAIT)
            if not data:
                raise ConnectionResetError("closed by the receiver")
            for record in connection.feedback(data):
                if isinstance(record, Read):
                    self._acknowledge(connection, record)
                else:
                    self._on_restart(record.stream, record.detector)
        except BlockingIOError:
            return
        except (OSError, ProtocolError) as error:
            self._connections.give_up(connection, error)

    def _acknowledge(self, connection: Outgoing, read: Read) -> None:
        with self._connections.changed:
            connection.heard_s = self._clock.monotonic_s()
            nbytes, at_s, passed = connection.heard(read, connection.heard_s)
            if nbytes:
                self._connections.rate.read(nbytes, at_s)
                for one in passed:
                    self._connections.rate.passed(one.nbytes, one.took_s, at_s)
                self._connections.changed.notify_all()

    def _keep(self, connection: Outgoing) -> None:
        """Silence, heartbeat, and the size of the kernel's buffer."""
        unheard_s = self._clock.monotonic_s() - connection.heard_s
        if unheard_s > self._params.broken_s:
            self._connections.give_up(connection, TimeoutError(f"silent for {self._params.broken_s:g} s"))
            return
        with self._connections.changed:
            if not self._connections.is_usable(connection.name):
                return
            self._beat(connection)
            limit_kernel(self._connections, connection)
            was, connection.silent = connection.silent, unheard_s > self._params.silence_s
            self._connections.tell_rate()
        if was != connection.silent:
            self._on_silence(connection.name, connection.silent)

    def _beat(self, connection: Outgoing) -> None:
        idle_s = self._clock.monotonic_s() - connection.wrote_s
        if connection.turn is None and idle_s >= self._params.heartbeat_s:
            connection.offer_heartbeat(self._connections.next_turn())
            self._connections.changed.notify_all()


def limit_kernel(connections: Connections, connection: Outgoing) -> None:
    """What the kernel holds cannot be taken back: keep it small, for the rate as it is now."""
    rate_bps = connections.rate.rate_bps(connections.clock.monotonic_s())
    if math.isinf(rate_bps):
        return
    wanted = max(connections.params.kernel_bytes, round(rate_bps / 8.0 * connections.params.kernel_s))
    if not 0.8 * wanted <= connection.held_bytes <= 1.25 * wanted:
        hold_at_most(connection.socket, wanted)
        connection.held_bytes = wanted
