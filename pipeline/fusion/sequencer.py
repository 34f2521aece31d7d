"""Puts the results of all substreams into the one order in which they are applied to the map."""

from __future__ import annotations

import bisect
import heapq
import math
from array import array
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from pipeline.messages import Detections, Dropped, EndOfStream

Substream = tuple[str, str]
#: a substream at one epoch of the mission's plan
Opened = tuple[str, str, int]
Order = tuple[int, str, str]


@dataclass(frozen=True)
class SequencerState:
    """All that a sequencer knows: see Sequencer. applied_ns: by substream. newest_ns: by every substream
    and epoch that was ever open; None before the first result. closed: of these, by ``close``.
    """

    open: list[Opened]
    newest_ns: dict[Opened, int | None]
    applied_ns: dict[Substream, array[int]]
    waiting: list[Detections]
    released: Order | None
    refused: dict[tuple[str, str, str], int]
    late: dict[Substream, int]
    closed: list[Opened]


class Sequencer:
    """Holds results back until no earlier one is still to come.

    With a finite lateness a result is released once some substream is that much ahead of it: results that
    come in any order are put right, as long as none comes after one that is newer by the lateness or more. A
    result that comes later still is released at once, out of its place, and counted. Without a lateness a
    result is released once every open substream has come as far, however long that takes; each substream must
    then send in order of time, perhaps again after a restart.

    A substream that is opened again at another epoch of the plan is waited for anew; results of the one before may
    still come. The same frame of the same substream is the same result, whatever its epoch.

    late: results released out of their place, by substream. refused: what was dropped, by (stream, detector,
    reason). "duplicate": it came before. "before the start". "unknown substream". "closed": its substream was.
    """

    def __init__(
        self,
        substreams: Collection[Substream],
        lateness_ns: int | None,
        start_ns: Mapping[str, int] | None = None,
    ) -> None:
        """substreams: open from the start, at epoch 0.

        lateness_ns: how long a result is waited for, by the time of capture; None: for ever.

        start_ns: capture time of each stream's first frame.
        """
        self.refused: Counter[tuple[str, str, str]] = Counter()
        self.late: Counter[Substream] = Counter()
        self._lateness_ns, self._start_ns = lateness_ns, start_ns or {}
        self._open: set[Opened] = {(*key, 0) for key in substreams}
        self._newest: dict[Opened, float] = dict.fromkeys(self._open, -math.inf)
        self._latest = -math.inf
        self._closed: set[Opened] = set()
        self._applied: dict[Substream, array[int]] = {key: array("q") for key in substreams}
        self._waiting: list[Order] = []
        self._results: dict[Order, Detections] = {}
        self._released: Order | None = None

    @property
    def open(self) -> frozenset[Opened]:
        """Substreams that are waited for, with their epoch."""
        return frozenset(self._open)

    @property
    def over(self) -> frozenset[Opened]:
        """Substreams that have ended or were closed."""
        return frozenset((self._newest.keys() | self._closed) - self._open)

    def open_again(self, stream: str, detector: str, epoch: int) -> None:
        """Wait for a substream from now on; once it was closed it stays so."""
        if (stream, detector, epoch) not in self._newest:
            self._open.add((stream, detector, epoch))
            self._newest[stream, detector, epoch] = -math.inf
            self._applied.setdefault((stream, detector), array("q"))

    def close(self, stream: str, detector: str, epoch: int) -> list[Detections]:
        """Take no more of a substream; the results that this releases, in order."""
        self._closed.add((stream, detector, epoch))
        return self._end((stream, detector, epoch))

    def push(self, message: Detections | Dropped | EndOfStream) -> list[Detections]:
        """Take one message and return the results that it releases, in order."""
        substream = message.stream, message.detector
        opened = (*substream, message.epoch)
        reason = self._reason_to_refuse(substream, message)
        if reason is not None:
            self.refused[(*substream, reason)] += 1
            return []
        if isinstance(message, EndOfStream):
            return self._end(opened)
        late = self._take(substream, message) if isinstance(message, Detections) else []
        self._newest[opened] = max(self._newest[opened], message.time_ns)
        self._latest = max(self._latest, message.time_ns)
        return late + self._release(self._watermark())

    def finish(self) -> list[Detections]:
        """Close every substream and return the remaining results, in order."""
        self._open.clear()
        return self._release(math.inf)

    @property
    def state(self) -> SequencerState:
        """A copy of what is needed to go on later."""
        return SequencerState(
            sorted(self._open),
            {key: None if newest == -math.inf else int(newest) for key, newest in self._newest.items()},
            {key: array("q", times) for key, times in self._applied.items()},
            [self._results[order] for order in sorted(self._waiting)],
            self._released,
            dict(self.refused),
            dict(self.late),
            sorted(self._closed),
        )

    def restore(self, state: SequencerState) -> None:
        """Go on where another sequencer of the same substreams stopped."""
        self._open = set(state.open)
        self._newest |= {
            key: -math.inf if newest is None else newest for key, newest in state.newest_ns.items()
        }
        self._latest = max(self._newest.values(), default=-math.inf)
        self._applied |= {key: array("q", times) for key, times in state.applied_ns.items()}
        self._results = {result.order: result for result in state.waiting}
        self._waiting, self._released = sorted(self._results), state.released
        self.refused, self.late = Counter(state.refused), Counter(state.late)
        self._closed = set(state.closed)

    def _end(self, opened: Opened) -> list[Detections]:
        self._open.discard(opened)
        return self._release(self._watermark())

    def _take(self, substream: Substream, result: Detections) -> list[Detections]:
        """Queue a result, or return it if its place in the order has passed."""
        if self._released is not None and result.order < self._released:
            self.late[substream] += 1
            bisect.insort(self._applied[substream], result.time_ns)
            return [result]
        heapq.heappush(self._waiting, result.order)
        self._results[result.order] = result
        return []

    def _reason_to_refuse(
        self, substream: Substream, message: Detections | Dropped | EndOfStream
    ) -> str | None:
        if (*substream, message.epoch) not in self._newest:
            return "unknown substream"
        if (*substream, message.epoch) in self._closed:
            return "closed"
        if not isinstance(message, Detections):
            return None
        if message.order in self._results or _holds(self._applied[substream], message.time_ns):
            return "duplicate"
        if message.time_ns < self._start_ns.get(message.stream, message.time_ns):
            return "before the start"
        return None

    def _watermark(self) -> float:
        """Capture time up to which everything has come, or is waited for no longer."""
        if not self._open:
            return math.inf
        if self._lateness_ns is None:
            return min(self._newest[opened] for opened in self._open)
        return self._latest - self._lateness_ns

    def _release(self, watermark: float) -> list[Detections]:
        released = []
        while self._waiting and self._waiting[0][0] <= watermark:
            self._released = heapq.heappop(self._waiting)
            released.append(self._results.pop(self._released))
            self._applied[self._released[1:]].append(self._released[0])
        return released


def _holds(times: array[int], time_ns: int) -> bool:
    """Whether sorted times hold one."""
    at = bisect.bisect_left(times, time_ns)
    return at < len(times) and times[at] == time_ns
