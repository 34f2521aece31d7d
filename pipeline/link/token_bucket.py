"""A token bucket: what a link of a given bandwidth lets through, and when. Time is an argument."""

from __future__ import annotations

import math


class TokenBucket:
    """Fills at rate_bps up to burst_bytes; full at first.

    rate_bps: bits per second, > 0, infinite for no limit. burst_bytes: >= 1. Who really sleeps oversleeps, by
    milliseconds; the rate is reached if the burst holds more than that of it.

    The state is one number, the time at which the bucket is full again (the "theoretical arrival time"
    of the generic cell rate algorithm): n bytes move it by n / rate, and are complete once it is at most
    burst / rate ahead.
    """

    def __init__(self, rate_bps: float, burst_bytes: float) -> None:
        if not rate_bps > 0.0 or not 1.0 <= burst_bytes < math.inf:
            raise ValueError(f"a token bucket of {rate_bps} bit/s and {burst_bytes} bytes")
        self.rate_bps, self.burst_bytes = rate_bps, burst_bytes
        self._burst_s = burst_bytes * 8.0 / rate_bps
        self._full_s = -math.inf

    def reserve(self, nbytes: int, now_s: float) -> float:
        """Time (s) at which the sending of nbytes, asked for now after all earlier ones, is complete.

        A message larger than the burst is allowed and leaves the bucket in debt. Between any t0 and t1, the
        bytes completed are at most max(burst, the largest reservation) + rate * (t1 - t0).
        """
        self._full_s = max(self._full_s, now_s) + nbytes * 8.0 / self.rate_bps
        return max(now_s, self._full_s - self._burst_s)

    def backlog_s(self, now_s: float) -> float:
        """Seconds until all that was reserved is complete; 0 if it is."""
        return max(0.0, self._full_s - self._burst_s - now_s)
