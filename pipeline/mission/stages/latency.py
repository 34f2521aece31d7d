"""Where the time of a result went: seconds on each part of its way, counted in buckets."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass, field

from pipeline.messages import Detections

#: source: from when the frame was due until it was given to the link, its own encoding left out. transfer: over the
#: link, the queue before it too. wait: at the machine, for the detector. return: from the machine to the reducer. hold:
#: of the watermark, which puts results in order. own: of these what is neither work, nor the link, nor the watermark:
#: source, wait and return. capture_to_map: all of them
HOPS = (
    "source",
    "encode",
    "transfer",
    "wait",
    "decode",
    "detect",
    "return",
    "hold",
    "own",
    "capture_to_map",
)
#: upper bounds of the latency histogram, seconds
LATENCY_BUCKETS_S = (
    *(0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0),
    *(10.0, 30.0, 120.0),
)


@dataclass
class HopHistogram:
    """Counts per bucket (the last one: above all bounds), and the sum of seconds."""

    counts: list[int] = field(default_factory=lambda: [0] * (len(LATENCY_BUCKETS_S) + 1))
    sum_s: float = 0.0

    def observe(self, seconds: float) -> None:
        """Count one value."""
        self.counts[bisect.bisect_left(LATENCY_BUCKETS_S, seconds)] += 1
        self.sum_s += seconds

    @property
    def count(self) -> int:
        """How many values there were."""
        return sum(self.counts)

    @property
    def mean_s(self) -> float | None:
        """None if there was no value."""
        return self.sum_s / self.count if self.count else None

    def at_most_s(self, share: float) -> float | None:
        """What this share (0..1) of the values do not exceed, as far as the buckets tell; inf: above all bounds."""
        if not self.count:
            return None
        least, so_far = math.ceil(share * self.count), 0
        for bound, count in zip((*LATENCY_BUCKETS_S, math.inf), self.counts, strict=True):
            so_far += count
            if so_far >= least:
                return bound
        raise AssertionError("all values are in a bucket")


def on_its_way(result: Detections, came_ns: int | None, applied_ns: int) -> dict[str, float]:
    """Seconds by hop. came_ns: when the reducer got it, applied_ns: when the map had it, ns UTC.

    Where the reducer (came_ns is None) or the machine did not look at a clock, what needs both is left out.
    """
    hops = result.hops
    seconds = {
        "source": hops.source_s,
        "encode": hops.encode_s,
        "transfer": hops.transfer_s,
        "wait": hops.wait_s,
        "decode": hops.decode_s,
        "detect": hops.detect_s,
    }
    if came_ns is None or not hops.answered_ns:
        return seconds
    seconds["return"] = max(0, came_ns - hops.answered_ns) * 1e-9
    seconds["hold"] = max(0, applied_ns - came_ns) * 1e-9
    total = sum(seconds.values())
    return seconds | {
        "own": hops.source_s + hops.wait_s + seconds["return"],
        "capture_to_map": total,
    }
