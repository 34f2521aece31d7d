"""The model of the reducer: what it takes is safe once it is on its disk, and only then acknowledged."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

from pipeline.mission.controller.events import ReducerReport
from pipeline.mission.controller.orders import Expect
from pipeline.mission.controller.substreams import Substream
from pipeline.mission.rehearsal.packets import Result, ResultEnd
from pipeline.mission.rehearsal.process import Process
from pipeline.mission.rehearsal.timeline import Timeline

REPORT_S = 0.25
COMMIT_S = 0.05


@dataclass
class Kept:
    """What the reducer knows of one substream.

    ends: how many packets it has, once that is known. closed, closed_s: why and when. counted: results it had then.
    """

    results: dict[int, Result] = field(default_factory=dict)
    ends: int | None = None
    closed: str | None = None
    closed_s: float = math.inf
    counted: int = 0

    def close(self, reason: str, now: float) -> None:
        """Take no more; what is missing is counted as lost from now on."""
        if self.closed is None:
            self.closed, self.closed_s, self.counted = reason, now, len(self.results)


class ModelReducer(Process):
    """disk: survives the process. applied: results in the order in which they were taken to the map."""

    def __init__(
        self,
        timeline: Timeline,
        report: Callable[[ReducerReport], None],
        acknowledge: Callable[[Substream, list[int]], None],
    ) -> None:
        super().__init__("reducer", timeline)
        self.disk: dict[Substream, Kept] = {}
        self.finished = False
        self._report, self._acknowledge = report, acknowledge
        self._unwritten: list[Result | ResultEnd] = []

    def start(self, incarnation: int) -> None:
        """A new process knows what is on the disk."""
        super().start(incarnation)
        self._unwritten = []
        self.every(COMMIT_S, self._commit)
        self.every(REPORT_S, self.report)
        self.report()

    def expect(self, order: Expect) -> None:
        """Open what is new, and close what should be closed; what is closed stays so."""
        self._commit()
        for key in order.keys:
            self.disk.setdefault(key, Kept())
        for close in order.close:
            self.disk.setdefault(close.substream, Kept()).close(close.reason, self.timeline.now)
        self.report()

    def take(self, message: Result | ResultEnd) -> None:
        """A message of a machine; it is not acknowledged before it is on the disk."""
        kept = self.disk.get(message.substream)
        if kept is not None and self._is_taken(kept, message):
            self._acknowledge(message.substream, [message.sequence])
        elif kept is not None and self._is_open(kept):
            self._unwritten.append(message)

    def report(self) -> None:
        """Say what is open and closed on the disk."""
        open_ = frozenset(key for key, kept in self.disk.items() if kept.closed is None)
        self._report(ReducerReport(self.incarnation, open_, frozenset(self.disk) - open_, self.finished))

    @staticmethod
    def _is_taken(kept: Kept, message: Result | ResultEnd) -> bool:
        return kept.ends is not None if isinstance(message, ResultEnd) else message.sequence in kept.results

    @staticmethod
    def _is_open(kept: Kept) -> bool:
        return kept.closed is None

    def _commit(self) -> None:
        unwritten, self._unwritten = self._unwritten, []
        for message in unwritten:
            kept = self.disk[message.substream]
            if not self._is_open(kept):
                continue
            if isinstance(message, ResultEnd):
                kept.ends = message.sequence
            else:
                kept.results.setdefault(message.sequence, message)
            self._acknowledge(message.substream, [message.sequence])
            if kept.ends is not None and len(kept.results) == kept.ends:
                kept.close("ended", self.timeline.now)
