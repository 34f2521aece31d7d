"""The links of a stream as TCP connections, one token bucket per site."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace

from pipeline.link.channel import LinkSender
from pipeline.link.token_bucket import TokenBucket
from pipeline.messages import EndOfStream, Message, Packet
from pipeline.mission.stages.virtual_link import burst_bytes

Address = tuple[str, int]


class RadioLink:
    """bandwidth_bps: per site. A site's detectors share its link; each has a connection of its own."""

    def __init__(self, bandwidth_bps: Mapping[str, float], capacity_bytes: int, token: bytes) -> None:
        self._token = token
        self.senders = {
            site: LinkSender(TokenBucket(rate, burst_bytes(rate)), capacity_bytes=capacity_bytes)
            for site, rate in bandwidth_bps.items()
            if rate > 0.0
        }

    def connect(self, site: str, detector: str, address: Address) -> None:
        """Open the connection to a detector at a site."""
        self.senders[site].connect(detector, address, self._token)

    def backlog_s(self, site: str, now_s: float) -> float:
        """Seconds that the site's link is behind."""
        return self.senders[site].backlog_s()

    def send(self, site: str, detector: str, message: Message, now_s: float) -> bool:
        """False if the link's queue is full; the end of a stream waits for room."""
        if isinstance(message, Packet):
            message = replace(message, sent_ns=time.time_ns())
        patience_s = None if isinstance(message, EndOfStream) else 0.0
        return self.senders[site].send(detector, message, timeout_s=patience_s)

    @property
    def bytes_sent(self) -> dict[str, int]:
        """Bytes that left, per site."""
        return {site: sender.bytes_sent for site, sender in self.senders.items()}

    def close(self) -> None:
        """Send what is queued, then close every connection."""
        for sender in self.senders.values():
            sender.flush()
            sender.close()
