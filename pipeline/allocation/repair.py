"""A valid plan at once: what can be kept is kept, and what broke is mended stream by stream.

The streams are gone through by rank. One whose substreams can all go on is left alone. Any other gets the
best configuration that the room left on the machines allows, keeping as many of its substreams as it can
(the exact pricing of ``pricing``, with fewer copies). If there is none, the streams of lower ranks make room
and are mended in their turn. No stream of a lower rank is ever in the way of one of a higher.
"""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.allocation.aggregation import Aggregation, StreamClass, aggregate
from pipeline.allocation.configuration import Choice
from pipeline.allocation.covering import phases_near
from pipeline.allocation.decomposed import kept_of, named
from pipeline.allocation.plan import Assignment
from pipeline.allocation.pricing import Pricer, Prices
from pipeline.allocation.pricing_states import IntArray
from pipeline.allocation.problem import Detector, Problem
from pipeline.allocation.room import Room

#: configurations of a stream that are tried on the machines, and how often with one kind less
_CONFIGURATIONS, _TRIES = 8, 4


@dataclass(frozen=True)
class Placed:
    """One detector of a stream at a level, and its choice in the aggregation."""

    detector: Detector
    choice: Choice


def repaired(
    problem: Problem, running: Sequence[Assignment], ranks: Mapping[str, int], deadline_s: float
) -> tuple[Assignment, ...]:
    """Assignments for as many streams as are found; streams that have none are not served.

    running: of ``still_there``. deadline_s: by time.monotonic(); what is not mended by then is not served.
    Raises NoPlanError where detPerStream allows too many covering patterns.
    """
    repair = Repair(problem, running, ranks)
    for stream in repair.order:
        if time.monotonic() > deadline_s:
            repair.drop_broken()
            break
        repair.mend(stream)
    uses = [(stream, one.choice, one.detector) for stream, of in repair.placed.items() for one in of]
    return named(problem, uses, running)


class Repair:
    """The machines, and where each stream has its detectors. order: of the streams, by rank."""

    def __init__(self, problem: Problem, running: Sequence[Assignment], ranks: Mapping[str, int]) -> None:
        self._problem, self._ranks, self._room = problem, ranks, Room(problem)
        self._aggregation = aggregate(problem, kept=kept_of(running), ranks=ranks)
        self._pricer = Pricer(self._aggregation)
        self._classes = {v: c for c in self._aggregation.classes for v in c.streams}
        by_id = {d.id: d for d in problem.detectors}
        self._detectors = [[by_id[name] for name in kind.detectors] for kind in self._aggregation.kinds]
        self._dear = 4.0 * (problem.detectors_per_stream + len(problem.sites))
        self.order = sorted(problem.streams, key=lambda stream: ranks.get(stream, 0))
        self.placed: dict[str, tuple[Placed, ...]] = {}
        self._broken: set[str] = set()
        self._before: dict[str, tuple[Placed, ...]] = self._running(running)
        for stream in self.order:
            self._reserve(stream, self._before.get(stream, ()), whole=self._whole(stream, running))

    def mend(self, stream: str) -> None:
        """Give the stream a configuration, if it has none that is whole."""
        if stream not in self._broken:
            return
        self._release(stream)
        found = self._found(stream)
        if found is None:
            lower = [v for v in self.order if self._rank(v) > self._rank(stream) and self.placed.get(v)]
            reserved = {v: self._release(v) for v in lower}
            found = self._found(stream) if lower else None
            self._put(stream, found or ())
            for v in lower:
                self._reserve(v, reserved[v], whole=v not in self._broken)
        else:
            self._put(stream, found)
        self._broken.discard(stream)

    def drop_broken(self) -> None:
        """Streams that are not mended are not served."""
        for stream in self._broken:
            self._release(stream)

    def _rank(self, stream: str) -> int:
        return self._ranks.get(stream, 0)

    def _running(self, running: Sequence[Assignment]) -> dict[str, tuple[Placed, ...]]:
        """The substreams that are still allowed, by stream."""
        kind_of = {d.id: (k, d) for k, of_kind in enumerate(self._detectors) for d in of_kind}
        found: dict[str, list[Placed]] = defaultdict(list)
        for a in running:
            level = self._problem.level(a.bitrate_bps, a.codec)
            if level is None or a.detector not in kind_of:
                continue
            kind, detector = kind_of[a.detector]
            if self._classes[a.stream].allowed[kind, level]:
                found[a.stream].append(Placed(detector, (kind, level)))
        return {stream: tuple(of) for stream, of in found.items()}

    def _whole(self, stream: str, running: Sequence[Assignment]) -> bool:
        """Whether all that ran can go on, as far as the stream itself is concerned."""
        mine = self._before.get(stream, ())
        if not mine or len(mine) != sum(a.stream == stream for a in running):
            return False
        if len(mine) > self._problem.detectors_per_stream:
            return False
        loads = Counter[int]()
        for one in mine:
            loads[self._aggregation.kinds[one.choice[0]].site] += int(self._aggregation.load[one.choice])
        if any(load > self._classes[stream].capacity[site] for site, load in loads.items()):
            return False
        periods = tuple(sorted(one.detector.period for one in mine))
        return phases_near(periods, (None,) * len(periods), self._problem.detectors_per_frame) is not None

    def _reserve(self, stream: str, wanted: Sequence[Placed], *, whole: bool) -> None:
        """Hold the room of what runs, as far as there is room; the stream is broken unless it is whole."""
        held = []
        for one in wanted:
            if self._room.holds(one.detector):
                self._room.put(one.detector)
                held.append(one)
        self.placed[stream] = tuple(held)
        if not whole or len(held) < len(wanted):
            self._broken.add(stream)

    def _release(self, stream: str) -> tuple[Placed, ...]:
        held = self.placed.pop(stream, ())
        for one in held:
            self._room.take(one.detector)
        return held

    def _put(self, stream: str, found: Sequence[Placed]) -> None:
        for one in found:
            self._room.put(one.detector)
        self.placed[stream] = tuple(found)

    def _found(self, stream: str) -> tuple[Placed, ...] | None:
        """The best configuration of the stream that the machines have room for, or None."""
        stream_class = self._classes[stream]
        copies = self._copies()
        for _ in range(_TRIES):
            prices = Prices(np.zeros(len(copies)), 1.0, self._dear)
            able = replace(stream_class, allowed=stream_class.allowed & (copies > 0)[:, None])
            tight: int | None = None
            for offer in self._pricer.best(able, prices, _CONFIGURATIONS, copies):
                placed = self._packed(stream, offer.choices)
                if not isinstance(placed, int):
                    return placed
                tight = placed if tight is None else tight
            if tight is None:
                return None
            copies[tight] -= 1
        return None

    def _copies(self) -> IntArray:
        """int64 (kinds,): on how many machines there is room for each kind, at most Kind.copies."""
        room = [sum(self._room.holds(d) for d in of_kind) for of_kind in self._detectors]
        most = [kind.copies for kind in self._aggregation.kinds]
        return np.minimum(np.array(room, dtype=np.int64), np.array(most, dtype=np.int64))

    def _packed(self, stream: str, choices: Sequence[Choice]) -> tuple[Placed, ...] | int:
        """Each choice on a machine with room, where it ran if it can, else the emptiest; or a kind too many.

        The room is as before afterwards.
        """
        stays = set(self._before.get(stream, ()))
        waiting = Counter(choices)
        placed: list[Placed] = []
        for one in sorted(stays, key=lambda one: one.detector.id):
            if waiting[one.choice] and self._room.holds(one.detector):
                waiting[one.choice] -= 1
                self._room.put(one.detector)
                placed.append(one)
        tight: int | None = None
        for choice in sorted(waiting.elements(), key=self._largest_first):
            taken = {one.detector.id for one in placed}
            free = [d for d in self._detectors[choice[0]] if d.id not in taken and self._room.holds(d)]
            if not free:
                tight = choice[0]
                break
            detector = max(free, key=lambda d: self._room.left(d.machine))
            self._room.put(detector)
            placed.append(Placed(detector, choice))
        for one in placed:
            self._room.take(one.detector)
        return tuple(placed) if tight is None else tight

    def _largest_first(self, choice: Choice) -> tuple[int, int]:
        return -self._aggregation.kinds[choice[0]].size, choice[0]


def value_bound(aggregation: Aggregation, streams: Sequence[str]) -> float:
    """No plan for these streams has a greater objective: each alone, without links, memory or patterns."""
    classes = {v: c for c in aggregation.classes for v in c.streams}
    return sum(_class_bound(aggregation, classes[v]) for v in streams)


def _class_bound(aggregation: Aggregation, stream_class: StreamClass) -> float:
    problem = aggregation.problem
    periods = np.array([kind.period for kind in aggregation.kinds])[:, None]
    value = np.maximum(aggregation.value_float(stream_class), 0.0)
    by_number = problem.detectors_per_stream * float(value.max(initial=0.0))
    by_frames = problem.detectors_per_frame * float((value * periods).max(initial=0.0))
    return min(by_number, by_frames) - (1.0 - problem.accuracy_weight)
