"""What is interchangeable in a problem: machines of one group, detectors of one kind, streams of one class.

Machines at one site with equal memory and equal detectors are one *group*. A detector on any machine of a
group is of one *kind*. Streams with equal links, accuracies and deadlines are one *class*. What a class does
with kinds says everything but names; names are given at the end (see ``packing``).
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from pipeline.allocation.problem import OBJECTIVE_RESOLUTION, Detector, Problem, memory_units
from pipeline.messages import FloatArray

#: a level that a class cannot use
FORBIDDEN = -math.inf
#: all streams are of rank 0
NO_RANKS: Mapping[str, int] = MappingProxyType({})
UNLIMITED = np.iinfo(np.int64).max

#: the substreams of a running plan: stream, detector, bitrate in bit/s, codec
Kept = frozenset[tuple[str, str, float, str]]


@dataclass(frozen=True)
class MachineGroup:
    """Equal machines. memory: in memory units, under the rule in force; None without a limit."""

    machines: tuple[str, ...]
    site: int
    memory: int | None


@dataclass(frozen=True)
class Kind:
    """One network on any machine of a group.

    detectors: ids, one per machine of the group, in its order. size: what it takes of the machine's memory.
    copies: how many of them one stream can use. sharing: see Detector.
    """

    group: int
    detectors: tuple[str, ...]
    period: int
    site: int
    size: int
    copies: int
    sharing: int | None


@dataclass(frozen=True, eq=False)
class StreamClass:
    """Equal streams.

    rank: 0 for the streams that are served first. value: int64 (kinds, levels), w * gain in
    OBJECTIVE_RESOLUTION. allowed: bool (kinds, levels). capacity:
    int64 (sites,), bits of one cycle, UNLIMITED without a limit. kept: int64 (kinds, levels), how many
    substreams of a running plan each of its streams has there.
    """

    streams: tuple[str, ...]
    value: NDArray[np.int64]
    allowed: NDArray[np.bool_]
    capacity: NDArray[np.int64]
    kept: NDArray[np.int64]
    rank: int = 0


@dataclass(frozen=True, eq=False)
class Aggregation:
    """A problem without names.

    load: int64 (kinds, levels), bits of one cycle that a substream sends. penalty: of one used link, in
    OBJECTIVE_RESOLUTION.
    """

    problem: Problem
    groups: tuple[MachineGroup, ...]
    kinds: tuple[Kind, ...]
    classes: tuple[StreamClass, ...]
    load: NDArray[np.int64]
    penalty: int

    @cached_property
    def streams_of_rank(self) -> tuple[int, ...]:
        """How many streams there are of each rank."""
        counts = Counter[int]()
        for stream_class in self.classes:
            counts[stream_class.rank] += len(stream_class.streams)
        return tuple(counts[rank] for rank in range(max(counts, default=-1) + 1))

    def value_float(self, stream_class: StreamClass) -> FloatArray:
        """float64 (kinds, levels): the value of each choice, FORBIDDEN where it is not allowed."""
        return np.where(stream_class.allowed, stream_class.value * OBJECTIVE_RESOLUTION, FORBIDDEN)


def aggregate(
    problem: Problem,
    apart: frozenset[str] = frozenset(),
    kept: Kept = frozenset(),
    alone: frozenset[str] = frozenset(),
    ranks: Mapping[str, int] = NO_RANKS,
) -> Aggregation:
    """Find what is interchangeable.

    apart: machines that stay groups of their own. alone: streams that stay classes of their own. ranks: of
    the streams, 0 .. without a gap; streams of several ranks are never of one class.
    """
    groups, kinds = _groups_and_kinds(problem, apart)
    load = np.array(
        [[round(b) * (problem.cycle // k.period) for b in problem.bitrates_bps] for k in kinds],
        dtype=np.int64,
    ).reshape(len(kinds), len(problem.bitrates_bps))
    classes = _classes(problem, kinds, load, kept, alone, ranks)
    return Aggregation(problem, groups, kinds, classes, load, problem.penalty_units)


def _groups_and_kinds(
    problem: Problem, apart: frozenset[str]
) -> tuple[tuple[MachineGroup, ...], tuple[Kind, ...]]:
    on_machine: dict[str, list[Detector]] = defaultdict(list)
    for detector in problem.detectors:
        on_machine[detector.machine].append(detector)
    sites = {site: s for s, site in enumerate(problem.sites)}
    members: dict[object, list[str]] = defaultdict(list)
    limits: dict[object, tuple[int, int | None]] = {}
    for machine in problem.machines:
        if machine.id not in on_machine:
            continue
        on_machine[machine.id].sort(key=_likeness)
        memory = _memory(problem, machine.memory_bytes)
        alike = tuple(_likeness(d) for d in on_machine[machine.id])
        key = machine.id if machine.id in apart else (machine.site, memory, alike)
        members[key].append(machine.id)
        limits[key] = sites[machine.site], memory
    groups = tuple(MachineGroup(tuple(names), *limits[key]) for key, names in members.items())
    kinds = []
    for g, group in enumerate(groups):
        for same in zip(*(on_machine[m] for m in group.machines), strict=True):
            first = same[0]
            kinds.append(
                Kind(
                    g,
                    tuple(d.id for d in same),
                    first.period,
                    group.site,
                    1
                    if problem.memory_rule == "one_detector_per_machine"
                    else memory_units(first.memory_bytes),
                    min(len(group.machines), problem.detectors_per_stream),
                    first.sharing,
                )
            )
    return groups, tuple(kinds)


def _likeness(detector: Detector) -> tuple[object, ...]:
    """All that matters of a detector but its name and machine."""
    return (
        detector.detector,
        detector.period,
        detector.memory_bytes,
        detector.accuracy,
        detector.execution_s,
        detector.sharing or 0,
    )


def _memory(problem: Problem, memory_bytes: float) -> int | None:
    if math.isinf(memory_bytes):
        return None
    return 1 if problem.memory_rule == "one_detector_per_machine" else memory_units(memory_bytes)


def _classes(
    problem: Problem,
    kinds: tuple[Kind, ...],
    load: NDArray[np.int64],
    kept: Kept,
    alone: frozenset[str],
    ranks: Mapping[str, int],
) -> tuple[StreamClass, ...]:
    by_id = {d.id: d for d in problem.detectors}
    firsts = [by_id[kind.detectors[0]] for kind in kinds]
    running: dict[str, list[tuple[str, int | None]]] = defaultdict(list)
    for stream, detector, bitrate_bps, codec in kept:
        running[stream].append((detector, problem.level(bitrate_bps, codec)))
    networks = sorted({d.detector for d in problem.detectors})
    kind_of = {detector: k for k, kind in enumerate(kinds) for detector in kind.detectors}
    streams: dict[object, list[str]] = defaultdict(list)
    counts: dict[object, dict[tuple[int, int], int]] = {}
    for stream in problem.streams:
        mine = _kept_counts(kind_of, running.get(stream, []))
        links = tuple(problem.link(stream, site) for site in problem.sites)
        own = tuple(problem.stream_accuracy.get((stream, network)) for network in networks)
        apart = stream if stream in alone else None
        key = (links, own, tuple(sorted(mine.items())), apart, ranks.get(stream, 0))
        streams[key].append(stream)
        counts[key] = mine
    return tuple(
        _stream_class(problem, kinds, firsts, load, tuple(names), counts[key], ranks.get(names[0], 0))
        for key, names in streams.items()
    )


def _kept_counts(
    kind_of: Mapping[str, int], running: list[tuple[str, int | None]]
) -> dict[tuple[int, int], int]:
    counts: dict[tuple[int, int], int] = defaultdict(int)
    for detector, level in running:
        if detector in kind_of and level is not None:
            counts[kind_of[detector], level] += 1
    return dict(counts)


def _stream_class(
    problem: Problem,
    kinds: tuple[Kind, ...],
    firsts: list[Detector],
    load: NDArray[np.int64],
    streams: tuple[str, ...],
    counts: Mapping[tuple[int, int], int],
    rank: int,
) -> StreamClass:
    name, levels = streams[0], range(len(problem.bitrates_bps))
    links = [problem.link(name, site) for site in problem.sites]
    capacity = np.array(
        [UNLIMITED if math.isinf(bps) else min(round(bps) * problem.cycle, UNLIMITED) for bps in links],
        dtype=np.int64,
    )
    # the shape is stated, since a problem may have lost all its detectors
    gains = [[problem.gain_units(name, d, b) for b in levels] for d in firsts]
    value = np.array(gains, dtype=np.int64).reshape(load.shape)
    timely = [[problem.in_time(name, d, b) for b in levels] for d in firsts]
    in_time = np.array(timely, dtype=bool).reshape(load.shape)
    fits = load <= capacity[[kind.site for kind in kinds], None]
    kept = np.zeros(load.shape, dtype=np.int64)
    for (k, b), count in counts.items():
        kept[k, b] = count
    return StreamClass(streams, value, in_time & fits, capacity, kept, rank)
