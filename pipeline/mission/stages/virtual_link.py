"""The links of a stream in video time: nothing sleeps, but every message pays for its bytes.

Used where a run goes as fast as it can (pace max, and the local run): the token bucket's clock is the capture
time, so that what a link cannot carry is dropped, at the same frames, however fast the machine is. It charges what a
connection would carry: the sealed record of the message, its head included. A connection's heartbeats are not charged.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

from pipeline.link.records import record_bytes
from pipeline.link.token_bucket import TokenBucket
from pipeline.messages import Message, Packet, pack

#: a stamp as long on the wire as a real one
_STAMPED_NS = 1 << 62


class VirtualLink:
    """deliver(detector, message) passes the message on and may block."""

    def __init__(self, bandwidth_bps: Mapping[str, float], deliver: Callable[[str, Message], None]) -> None:
        self._buckets = {site: TokenBucket(rate, burst_bytes(rate)) for site, rate in bandwidth_bps.items()}
        self._deliver = deliver
        self.bytes_sent = dict.fromkeys(bandwidth_bps, 0)

    def is_up(self, site: str, detector: str) -> bool:
        """Always."""
        return True

    def backlog_s(self, site: str, now_s: float) -> float:
        """Seconds of video time that the link is behind."""
        return self._buckets[site].backlog_s(now_s)

    def send(self, site: str, detector: str, message: Message, now_s: float) -> bool:
        """Always takes the message."""
        nbytes = wire_bytes(message)
        self.bytes_sent[site] += nbytes
        done_s = self._buckets[site].reserve(nbytes, now_s)
        if isinstance(message, Packet):
            message = replace(message, link_s=done_s - now_s)
        self._deliver(detector, message)
        return True

    def take_restarts(self) -> Collection[str]:
        """None: nothing is lost on it."""
        return ()

    def take_lost(self) -> Collection[Packet]:
        """None."""
        return ()


def wire_bytes(message: Message) -> int:
    """What a connection carries for a message, which it stamps if it is a packet."""
    stamped = replace(message, sent_ns=_STAMPED_NS) if isinstance(message, Packet) else message
    return record_bytes(pack(stamped))


def burst_bytes(rate_bps: float) -> float:
    """A link may send so much at once: 50 ms of its rate, one Ethernet frame at least, a megabyte at most."""
    return min(max(1500.0, 0.050 * rate_bps / 8.0), 1e6)


def unlimited() -> TokenBucket:
    """The bucket of a connection that no radio limits."""
    return TokenBucket(math.inf, 1e6)
