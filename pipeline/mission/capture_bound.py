"""Which capture times cannot be yet: a frame of tomorrow would make all that comes before it late.

In real time a stream's newest frame is of now, by the mission's clock; no frame is newer than that by more than the
lateness, which is what clocks of drones may be apart anyway. Of recorded video no frame is newer than its end, at any
pace.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from pipeline.clock import Clock
from pipeline.mission.stages.source import StreamInput


class CaptureBound:
    """slack_s: what clocks may be apart."""

    def __init__(self, streams: Sequence[StreamInput], slack_s: float, clock: Clock | None = None) -> None:
        self._end_ns = {s.stream: s.start_ns + (s.end_s + slack_s) * 1e9 for s in streams if not s.is_live}
        self._slack_ns, self._clock = slack_s * 1e9, clock or Clock()
        self._ahead_ns: dict[str, float] = {}

    def runs(self, now_ns: Mapping[str, int]) -> None:
        """The mission's clock runs. now_ns: the capture time that each stream has now, ns UTC."""
        own_ns = self._clock.monotonic_s() * 1e9
        self._ahead_ns = {stream: ns - own_ns for stream, ns in now_ns.items()}

    def is_beyond(self, stream: str, time_ns: int) -> bool:
        """Whether a frame of the stream cannot have this capture time, ns UTC."""
        if time_ns > self._end_ns.get(stream, math.inf):
            return True
        ahead_ns = self._ahead_ns.get(stream, math.inf)
        return time_ns > self._clock.monotonic_s() * 1e9 + ahead_ns + self._slack_ns

    def ages_s(self, newest_ns: Mapping[tuple[str, str], int]) -> dict[str, float]:
        """By stream, how long ago the newest frame was taken that the map knows, if it knows one; empty before the
        mission's clock runs. newest_ns: capture times by stream and detector, ns UTC.
        """
        now_ns = self._clock.monotonic_s() * 1e9
        known: dict[str, int] = {}
        for (stream, _), ns in newest_ns.items():
            known[stream] = max(ns, known.get(stream, 0))
        return {s: (now_ns + self._ahead_ns[s] - ns) * 1e-9 for s, ns in known.items() if s in self._ahead_ns}
