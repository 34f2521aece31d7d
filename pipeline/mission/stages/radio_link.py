"""The links of a stream over the network: one token bucket per site, one connection per address there.

A site's substreams share its connection: each message names its own. What the link really lets through is measured
(``pipeline.link.rate_estimate``), and ``backlog_s`` goes by that.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

from pipeline.clock import Clock
from pipeline.errors import ProtocolError, RunFailedError
from pipeline.link.keys import Endpoint, KeyPair
from pipeline.link.params import LinkParams
from pipeline.link.sender import LinkSender, LinkState
from pipeline.link.token_bucket import TokenBucket
from pipeline.messages import EndOfStream, Message, Packet
from pipeline.mission.stages.virtual_link import burst_bytes


@dataclass(frozen=True)
class RadioParams:
    """queue_bytes: of one connection that may be unread at the far end. end_s: how long the end of a stream waits for a
    link that is down or full, and how long a closing link waits for the next byte to be read. stalled_s: the same where
    nothing is dropped and a machine makes its sources wait (pace max).
    """

    queue_bytes: int = 4 * 1024 * 1024
    end_s: float = 30.0
    stalled_s: float = 150.0
    link: LinkParams = field(default_factory=LinkParams)

    def __post_init__(self) -> None:
        if self.queue_bytes < 1 or not (self.end_s > 0.0 and self.stalled_s > 0.0):
            raise ValueError(f"{self}; expected at least one byte, and times above 0")


class RadioLink:
    """stream: whose. bandwidth_bps: declared, per site. keys: of who sends.

    on_lost(site, connection, reason), on_back(site, connection): see LinkSender; called on its threads.
    """

    def __init__(
        self,
        stream: str,
        bandwidth_bps: Mapping[str, float],
        keys: KeyPair,
        params: RadioParams | None = None,
        clock: Clock | None = None,
        on_lost: Callable[[str, str, str], None] = lambda site, name, reason: None,
        on_back: Callable[[str, str], None] = lambda site, name: None,
    ) -> None:
        self._stream = stream
        self._params, self._clock = params or RadioParams(), clock or Clock()
        self._on_lost = on_lost
        self._lock = threading.Lock()
        self._restarts: set[str] = set()
        self._connections: dict[str, str] = {}
        self.senders = {
            site: LinkSender(
                TokenBucket(rate, burst_bytes(rate)),
                capacity_bytes=self._params.queue_bytes,
                keys=keys,
                name=f"stream {stream}",
                params=self._params.link,
                clock=self._clock,
                reconnect=True,
                on_lost=partial(self._lost, site),
                on_back=partial(on_back, site),
                on_restart=lambda _, detector: self._restart([detector]),
            )
            for site, rate in bandwidth_bps.items()
            if rate > 0.0
        }

    def connect(self, site: str, detector: str, endpoint: Endpoint) -> None:
        """Open the way to a detector at a site, over the connection to its endpoint, if there is one.

        Raises RunFailedError, with the names of both ends, if there can be none.
        """
        name = _connection(site, endpoint)
        if name not in self._connections.values():
            try:
                self.senders[site].connect(name, endpoint)
            except (OSError, ProtocolError) as error:
                raise RunFailedError(f"stream {self._stream}: no connection to {name}: {error}") from None
        self._connections[detector] = name

    def expect(self, site: str, detector: str, endpoint: Endpoint | None) -> None:
        """As ``connect``; where nobody can be reached there, the way is down until somebody can, or the next call."""
        if endpoint is None:
            self._connections.pop(detector, None)
            return
        name = _connection(site, endpoint)
        is_new = name not in self._connections.values()
        self._connections[detector] = name
        if is_new:
            self.senders[site].expect(name, endpoint)

    def is_up(self, site: str, detector: str) -> bool:
        """Whether the connection is neither broken nor silent."""
        name = self._connections.get(detector)
        return name is not None and self.senders[site].is_up(name)

    def backlog_s(self, site: str, now_s: float) -> float:
        """Seconds that the site's link is behind, at the rate that was measured."""
        return self.senders[site].backlog_s()

    def send(self, site: str, detector: str, message: Message, now_s: float) -> bool:
        """False if the connection is broken or full; the end of a stream waits, at most ``end_s``."""
        if isinstance(message, Packet):
            message = replace(message, sent_ns=self._clock.utc_ns())
        until_s = self._clock.monotonic_s() + (
            self._params.end_s if isinstance(message, EndOfStream) else 0.0
        )
        while detector in self._connections:
            left_s = max(0.0, until_s - self._clock.monotonic_s())
            try:
                return self.senders[site].send(self._connections[detector], message, timeout_s=left_s)
            except ConnectionError:  # it is being made again
                if left_s <= 0.0:
                    return False
                self._clock.sleep(min(left_s, self._params.link.backoff.first_s))
        return False

    def take_restarts(self) -> Collection[str]:
        """Detectors whose next packet must stand alone; each is told once."""
        with self._lock:
            restarts, self._restarts = self._restarts, set()
            return restarts

    def take_lost(self) -> Collection[Packet]:
        """Packets whose connection broke before they were known to be read; each is told once."""
        lost = [message for sender in self.senders.values() for message in sender.take_lost()]
        return [message for message in lost if isinstance(message, Packet)]

    def states(self) -> dict[str, LinkState]:
        """What is known of each site's link."""
        return {site: sender.state() for site, sender in self.senders.items()}

    @property
    def bytes_sent(self) -> dict[str, int]:
        """Bytes that left, per site."""
        return {site: sender.bytes_sent for site, sender in self.senders.items()}

    def close(self) -> list[str]:
        """Wait until what was sent is read, then close every connection; the sites that did not read it all."""
        unread = [site for site, sender in self.senders.items() if not sender.flush(self._params.end_s)]
        for sender in self.senders.values():
            sender.close()
        return unread

    def _restart(self, detectors: Collection[str]) -> None:
        with self._lock:
            self._restarts.update(detectors)

    def _lost(self, site: str, name: str, reason: str) -> None:
        """A decoder at a broken connection has missed something, or is a new one; at a silent one it has not."""
        if self.senders[site].state().down.get(name) not in (None, "silent"):
            self._restart([d for d, connection in self._connections.items() if connection == name])
        self._on_lost(site, name, reason)


def _connection(site: str, endpoint: Endpoint) -> str:
    return f"{site} at {endpoint.host}:{endpoint.port}"
