"""The limits of a connection; each names the failure that it prevents."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

from pipeline.link.backoff import BackoffParams
from pipeline.link.rate_estimate import RateParams


@dataclass(frozen=True)
class LinkParams:
    """Seconds, all > 0.

    connect_s: for the connection and for the proof of the keys, each; a host that does not answer must not hold up
    a mission. silence_s: an open connection of which nothing was heard for so long is reported as silent.
    broken_s: after so much silence it is closed and made again. heartbeat_s: the most that each end is silent by
    itself. ack_s, ack_bytes: the far end says what it has read after so long, or after so much (but not more often
    than every fifth of ack_s, unless it is a megabyte).
    kernel_s: what the kernel may hold of the link's rate: what it holds cannot be taken
    back, and it is what an outage makes old. kernel_bytes: the least that it may hold. send_s: how long a message waits
    for room, unless its sender says otherwise.

    Of a receiver: most_greeted: connections that have not proven their key yet; most_connections: of one key;
    reserve_descriptors: kept for times when the process has no others: nobody may make it deaf.
    """

    connect_s: float = 5.0
    silence_s: float = 1.0
    broken_s: float = 10.0
    heartbeat_s: float = 0.25
    ack_s: float = 0.05
    ack_bytes: int = 32 * 1024
    kernel_s: float = 0.1
    kernel_bytes: int = 4096
    send_s: float = 30.0
    most_greeted: int = 64
    most_connections: int = 64
    reserve_descriptors: int = 4
    rate: RateParams = field(default_factory=RateParams)
    backoff: BackoffParams = field(default_factory=BackoffParams)

    def __post_init__(self) -> None:
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("rate", "backoff")}
        for name, value in values.items():
            if not 0.0 < value < math.inf:
                raise ValueError(f"LinkParams.{name} = {value}; expected a positive, finite number")
        if not self.ack_s <= self.heartbeat_s < self.silence_s <= self.broken_s:
            raise ValueError(f"{self}; expected ack_s <= heartbeat_s < silence_s <= broken_s")
