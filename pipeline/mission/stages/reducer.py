"""The reducer stage: results in, in any order; the map out, the same for every order."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping

from pipeline.allocation.plan import Assignment, assignment_from_json
from pipeline.fusion.fuser import Fuser
from pipeline.fusion.replay import Replay, ReplayParams
from pipeline.fusion.sequencer import Sequencer
from pipeline.logs import Log
from pipeline.messages import Detections, Dropped, EndOfStream, Message
from pipeline.mission.stages.frame_tally import FrameTally
from pipeline.mission.stages.latency import HOPS, HopHistogram, on_its_way

_LOG = Log("fusion")
_LATE = "late, applied out of its place"
#: without a lateness nothing comes late
NO_REPLAY = ReplayParams()


Learn = Callable[[Fuser, Assignment, int], None]


def nothing_to_learn(fuser: Fuser, assignment: Assignment, epoch: int) -> None:
    """Every substream is worth what its detector is."""


class ReducerStage:
    """Owns the map. received, processed, dropped: frame indices per (stream, detector).

    begun_with: substreams that it was made for. opened: what was opened later, assignments as JSON by substream and
    epoch. closed: why a substream was closed before its end, by (stream, detector). drops: how many of
    ``dropped``, by reason. tallies: frames by stream, each once. fuser: whoever reads its map calls ``settle`` before.
    utc_ns: a clock, in real time, by which results are timed; None: those on their way to the reducer are not.
    """

    def __init__(
        self,
        fuser: Fuser,
        sequencer: Sequencer,
        substreams: Iterable[tuple[str, str]],
        learn: Learn = nothing_to_learn,
        replay: ReplayParams = NO_REPLAY,
    ) -> None:
        """learn(fuser, assignment, epoch): tell the fuser what a substream that is opened later is worth."""
        self.fuser, self.replay = fuser, Replay(fuser, replay)
        self.received: dict[tuple[str, str], set[int]] = {}
        self.processed: dict[tuple[str, str], set[int]] = {}
        self.dropped: dict[tuple[str, str], dict[int, str]] = {}
        self.drops: dict[tuple[str, str], Counter[str]] = {}
        self.tallies: defaultdict[str, FrameTally] = defaultdict(FrameTally)
        self.detections: Counter[tuple[str, str]] = Counter()
        self.hops: dict[tuple[str, str], dict[str, HopHistogram]] = {}
        self.sequencer, self._learn = sequencer, learn
        self.utc_ns: Callable[[], int] | None = None
        self._came_ns: dict[tuple[str, str, int, int], int] = {}
        self.closed: dict[tuple[str, str], str] = {}
        self.opened: dict[tuple[str, str, int], str] = {}
        self.begun_with = tuple(sorted(substreams))
        for key in self.begun_with:
            self._account_for(*key)

    @property
    def open(self) -> frozenset[tuple[str, str, int]]:
        """Substreams whose end has not come: stream, detector, epoch."""
        return self.sequencer.open

    def open_again(self, stream: str, detector: str, epoch: int, assignment: str = "") -> None:
        """Take results of a substream from now on. assignment: as JSON, see ``assignment_to_json``; if it is empty the
        substream is worth what its detector is.
        """
        self.learn({(stream, detector, epoch): assignment} if assignment else {})
        self._account_for(stream, detector)
        self.sequencer.open_again(stream, detector, epoch)
        _LOG.event("substream begins", stream=stream, detector=detector, epoch=epoch, open=len(self.open))

    def learn(self, opened: Mapping[tuple[str, str, int], str]) -> None:
        """What substreams are worth that were opened later: assignments as JSON."""
        self.opened |= opened
        for (_, _, epoch), assignment in opened.items():
            self._learn(self.fuser, assignment_from_json(assignment), epoch)

    def close(self, stream: str, detector: str, epoch: int, reason: str) -> None:
        """Wait no longer for the end of a substream."""
        self._apply(self.sequencer.close(stream, detector, epoch))
        self.closed[stream, detector] = reason
        _LOG.event("substream closed", stream=stream, detector=detector, epoch=epoch, reason=reason)

    def _account_for(self, stream: str, detector: str) -> None:
        key = stream, detector
        self.received.setdefault(key, set())
        self.processed.setdefault(key, set())
        self.dropped.setdefault(key, {})
        self.drops.setdefault(key, Counter())
        self.hops.setdefault(key, {hop: HopHistogram() for hop in HOPS})

    def push(self, message: Message) -> None:
        """Take one message of any substream."""
        if isinstance(message, Dropped):
            self._drop(message)
        if isinstance(message, Detections):
            self.received[message.stream, message.detector].add(message.index)
            if self.utc_ns is not None:
                self._came_ns[_numbered(message)] = self.utc_ns()
        if isinstance(message, Detections | Dropped | EndOfStream):
            self._apply(self.sequencer.push(message))
        if isinstance(message, EndOfStream):
            open_ = len(self.open)
            _LOG.event("substream ends", stream=message.stream, detector=message.detector, open=open_)

    def finish(self) -> None:
        """Apply what is still held back; nothing is opened any more."""
        self._learn = nothing_to_learn
        self._apply(self.sequencer.finish())
        self.settle()
        fuser = self.fuser
        _LOG.event("map finished", sightings=len(fuser.looks), refused=fuser.refused, unplaced=fuser.unplaced)

    def settle(self) -> None:
        """Put late results in their place, see ``Replay``; it may take as long as the map of some minutes takes."""
        self.replay.settle()

    @property
    def not_taken(self) -> dict[str, int]:
        """What did not change the map, or not in its place: results that came twice or late, bad input, boxes
        without a place.
        """
        results = Counter({_LATE: self.replay.out_of_place.total()})
        for (_, _, reason), count in self.sequencer.refused.items():
            results[reason] += count
        return dict(+results + self.fuser.refused + self.fuser.unplaced)

    def frames(self, stream: str) -> set[int]:
        """Indices of the frames of a stream that at least one detector has looked at."""
        return self.tallies[stream].looked

    def frames_dropped(self, stream: str) -> dict[str, int]:
        """Frames of a stream that reached a machine but that nobody looked at, by reason."""
        return dict(+self.tallies[stream].reasons)

    def count_again(self) -> None:
        """Of what ``processed`` and ``dropped`` say, after somebody has put other accounts there."""
        self.tallies.clear()
        self.drops = {key: Counter(frames.values()) for key, frames in self.dropped.items()}
        for (stream, _), dropped in self.dropped.items():
            for index, reason in dropped.items():
                self.tallies[stream].drop(index, reason)
        for (stream, _), frames in self.processed.items():
            for index in frames:
                self.tallies[stream].look(index)

    def _drop(self, message: Dropped) -> None:
        key = message.stream, message.detector
        former = self.dropped[key].get(message.index)
        if former is not None:
            self.drops[key][former] -= 1
        self.dropped[key][message.index] = message.reason
        self.drops[key][message.reason] += 1
        self.tallies[message.stream].drop(message.index, message.reason)

    def _apply(self, results: Iterable[Detections]) -> None:
        for result in results:
            self.replay.apply(result)
            self.processed[result.stream, result.detector].add(result.index)
            self.tallies[result.stream].look(result.index)
            self.detections[result.stream, result.detector] += len(result.scores)
            self._time(result)

    def _time(self, result: Detections) -> None:
        now_ns = 0 if self.utc_ns is None else self.utc_ns()
        histograms = self.hops[result.stream, result.detector]
        for hop, seconds in on_its_way(result, self._came_ns.pop(_numbered(result), None), now_ns).items():
            histograms[hop].observe(seconds)


def _numbered(result: Detections) -> tuple[str, str, int, int]:
    return result.stream, result.detector, result.epoch, result.sequence
