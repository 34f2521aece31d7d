"""What a link really lets through, from what its far end says it has read. No clock, no socket: time is an argument.

A link is *full* while its sender could write more than the kernel takes. Only then does what arrives say what the link
can do; at all other times it says what was offered. So

- while the link is full, the estimate is the mean rate of what was read in the last ``window_s`` of it;
- while it is not, the estimate stays, and is raised to what was seen to pass, in ``least_s`` or as one message: being
  offered little lowers nothing, and a link that is good again is known by its largest pictures.

The estimate begins at the declared rate and is never above it, since the sender keeps to the declared rate by itself.
(The same distinction as in BBR, which calls a sample "application-limited".)
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True)
class RateParams:
    """window_s: of the mean. least_s: a shorter time says nothing; bursts and late threads are in it.

    drained_s: how long after the last refused write the link is still full; less than what the kernel's buffer,
    two thirds full, takes to drain. burst_bytes: of a message, what a shaper may let through at once, whatever its
    rate; a message of less than twice as much says nothing.
    """

    window_s: float = 1.2
    least_s: float = 0.25
    drained_s: float = 0.05
    burst_bytes: int = 4 * 1514

    def __post_init__(self) -> None:
        if not 0.0 < self.drained_s < self.least_s < self.window_s < math.inf or self.burst_bytes < 0:
            raise ValueError(f"{self}; expected 0 < drained_s < least_s < window_s, burst_bytes >= 0")


@dataclass(frozen=True, slots=True)
class _Read:
    """total bytes read at at_s; full_s: seconds since the one before, if the link was full all the while, else 0."""

    at_s: float
    total: int
    full_s: float
    full_bytes: int


class RateEstimate:
    """Of one link. declared_bps: > 0, infinite for a link that nothing limits as far as anybody knows.

    least_bps: the lowest estimate so far.
    """

    def __init__(self, declared_bps: float, params: RateParams | None = None) -> None:
        if not declared_bps > 0.0:
            raise ValueError(f"a link of {declared_bps} bit/s")
        self._params = params or RateParams()
        self._declared_bps = declared_bps
        self._rate_bps = self.least_bps = declared_bps
        self._reads: deque[_Read] = deque()
        self._full_s, self._full_bytes = 0.0, 0
        self._blocked = False
        self._full_from_s, self._full_until_s = math.inf, -math.inf

    def blocked(self, now_s: float) -> None:
        """The kernel takes no more."""
        if not self.is_full(now_s):
            self._full_from_s = now_s
        self._blocked = True

    def free(self, now_s: float) -> None:
        """The kernel takes more again, or nothing is left to write."""
        if self._blocked:
            self._blocked = False
            self._full_until_s = now_s + self._params.drained_s

    def is_full(self, now_s: float) -> bool:
        """Whether more is offered than the link takes."""
        return self._blocked or now_s <= self._full_until_s

    def read(self, nbytes: int, at_s: float) -> None:
        """The far end has read nbytes more, the last of them at at_s."""
        last = self._reads[-1] if self._reads else _Read(at_s, 0, 0.0, 0)
        at_s = max(at_s, last.at_s)
        full = bool(self._reads) and self._full_from_s <= last.at_s and self.is_full(at_s)
        read = _Read(at_s, last.total + nbytes, at_s - last.at_s if full else 0.0, nbytes if full else 0)
        self._append(read)
        if full and self._full_s >= self._params.least_s:
            self._set(self._full_bytes * 8.0 / self._full_s)
        elif not full:
            self._set(max(self._rate_bps, self._passed_bps()))

    def passed(self, nbytes: int, took_s: float, now_s: float) -> None:
        """A message of nbytes was read whole, at most took_s after its first byte was written."""
        known = self.is_full(now_s) and self._full_s >= self._params.least_s  # by the mean, which is better
        if known or nbytes < 2 * self._params.burst_bytes or took_s <= 0.0:
            return
        self._set(max(self._rate_bps, (nbytes - self._params.burst_bytes) * 8.0 / took_s))

    def rate_bps(self, now_s: float) -> float:
        """Bits per second, at most the declared ones; sinks while the link is full and nothing is read."""
        if not self._reads or not self.is_full(now_s):
            return self._rate_bps
        silent_s = now_s - max(self._reads[-1].at_s, self._full_from_s)
        if silent_s <= self._params.least_s:
            return self._rate_bps
        bits = 8.0 * sum(r.full_bytes for r in self._reads if r.at_s > now_s - self._params.window_s)
        return min(self._rate_bps, bits / min(self._full_s + silent_s, self._params.window_s))

    def backlog_s(self, unread_bytes: int, now_s: float) -> float:
        """Seconds that the link needs for what was offered and is not known to be read; infinite if it stands still."""
        if unread_bytes == 0:
            return 0.0
        rate_bps = self.rate_bps(now_s)
        return unread_bytes * 8.0 / rate_bps if rate_bps > 0.0 else math.inf

    def _append(self, read: _Read) -> None:
        self._reads.append(read)
        self._full_s += read.full_s
        self._full_bytes += read.full_bytes
        while self._reads[0].at_s < read.at_s - self._params.window_s:
            gone = self._reads.popleft()
            self._full_s -= gone.full_s
            self._full_bytes -= gone.full_bytes

    def _passed_bps(self) -> float:
        """What passed in the shortest time that says something, all of it after the link was full."""
        newest = self._reads[-1]
        for read in reversed(self._reads):
            if newest.at_s - read.at_s >= self._params.least_s:
                return (newest.total - read.total) * 8.0 / (newest.at_s - read.at_s)
            if read.full_s > 0.0:
                break
        return 0.0

    def _set(self, rate_bps: float) -> None:
        self._rate_bps = min(rate_bps, self._declared_bps)
        self.least_bps = min(self.least_bps, self._rate_bps)
