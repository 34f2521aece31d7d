"""Puts the results of all substreams into the one order in which they are applied to the map."""

from __future__ import annotations

import heapq
import math
from collections import Counter
from collections.abc import Collection

from pipeline.messages import Detections, Dropped, EndOfStream

Substream = tuple[str, str]
Order = tuple[int, str, str]


class Sequencer:
    """Holds results back until no earlier one is still to come.

    A substream (stream, detector) sends in order of time, perhaps again after a restart. A result is released
    once every open substream has come as far (the watermark); with a finite lateness also once some substream
    is that much ahead.

    refused: what was dropped, by (stream, detector, reason). "duplicate": it came before. "late": results
    after it have been released already. "unknown substream".
    """

    def __init__(self, substreams: Collection[Substream], lateness_ns: int | None) -> None:
        """lateness_ns: how long a substream is waited for, by the time of capture; None: for ever."""
        self.refused: Counter[tuple[str, str, str]] = Counter()
        self._lateness_ns = lateness_ns
        self._open = set(substreams)
        self._newest: dict[Substream, float] = dict.fromkeys(substreams, -math.inf)
        self._waiting: list[Order] = []
        self._results: dict[Order, Detections] = {}
        self._released: Order | None = None

    def push(self, message: Detections | Dropped | EndOfStream) -> list[Detections]:
        """Take one message and return the results that it releases, in order."""
        substream = message.stream, message.detector
        if substream not in self._newest:
            self.refused[(*substream, "unknown substream")] += 1
            return []
        if isinstance(message, EndOfStream):
            self._open.discard(substream)
        else:
            if isinstance(message, Detections):
                self._take(substream, message)
            self._newest[substream] = max(self._newest[substream], message.time_ns)
        return self._release(self._watermark())

    def finish(self) -> list[Detections]:
        """Close every substream and return the remaining results, in order."""
        self._open.clear()
        return self._release(math.inf)

    def _take(self, substream: Substream, result: Detections) -> None:
        reason = self._reason_to_refuse(substream, result)
        if reason is not None:
            self.refused[(*substream, reason)] += 1
            return
        heapq.heappush(self._waiting, result.order)
        self._results[result.order] = result

    def _reason_to_refuse(self, substream: Substream, result: Detections) -> str | None:
        if result.order in self._results:
            return "duplicate"
        if self._released is None or result.order > self._released:
            return None
        return "duplicate" if result.time_ns <= self._newest[substream] else "late"

    def _watermark(self) -> float:
        """Capture time up to which everything has come, or is waited for no longer."""
        waited_for = min((self._newest[substream] for substream in self._open), default=math.inf)
        if self._lateness_ns is None:
            return waited_for
        return max(waited_for, max(self._newest.values(), default=-math.inf) - self._lateness_ns)

    def _release(self, watermark: float) -> list[Detections]:
        released = []
        while self._waiting and self._waiting[0][0] <= watermark:
            self._released = heapq.heappop(self._waiting)
            released.append(self._results.pop(self._released))
        return released
