"""Why a stream goes unserved: the limit without which it could be served, in one line."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

from pipeline.allocation.plan import Assignment
from pipeline.allocation.problem import MachineLimit, Problem
from pipeline.allocation.repair import repaired
from pipeline.allocation.room import Room
from pipeline.errors import NoPlanError

#: one stream alone is placed in some 10 ms
_LIMIT_S = 1.0
#: wider than any link, and still exact in whole bits of a cycle
_WIDE_BPS = 1e13


def reason(problem: Problem, stream: str, placed: Sequence[Assignment], *, sure: bool) -> str:
    """Which limit leaves the stream out. placed: the detectors of the streams that are served. sure: whether
    it is proven that no more streams can be served.

    One that cannot be served on empty machines either is told which limit, lifted alone, would help; of
    several the first in the order of links, deadline, memory, detectors_per_stream, detectors_per_frame.
    """
    alone = replace(problem, streams=(stream,))
    if not problem.detectors:
        return "there is no detector left"
    if not any(problem.link(stream, site) > 0.0 for site in {d.site for d in problem.detectors}):
        return "it has no link to a site with a detector"
    if _possible(alone):
        full = _full(problem, stream, placed)
        return full if sure else f"no place was found for it in time; perhaps {full}"
    for text, lifted in _lifted(alone, stream):
        if _possible(lifted):
            return text
    free = replace(alone, link_bps=_no_limit(alone, stream), deadline=None, machines=_boundless(alone))
    if _possible(free):
        deadline = "" if alone.deadline is None else f" and a result within {alone.deadline.limit_s:g} s"
        return f"its links ({_links(problem, stream)}) and the machines' memory{deadline} exclude each other"
    most, rate_hz = problem.detectors_per_stream, problem.frame_rate_hz
    return f"no {most} of the detectors together see every frame at {rate_hz:g} Hz"


def _possible(alone: Problem) -> bool:
    try:
        return bool(repaired(alone, (), {}, time.monotonic() + _LIMIT_S))
    except NoPlanError:  # too many patterns to look at: not to be decided
        return False


def _lifted(alone: Problem, stream: str) -> Iterator[tuple[str, Problem]]:
    """Each limit as words, and the problem of the stream alone without it."""
    least_bps = alone.bitrates_bps[0]
    yield (
        f"its links carry too little ({_links(alone, stream)}; the least level is {least_bps / 1e6:g} Mbps)",
        replace(alone, link_bps=_no_limit(alone, stream)),
    )
    if alone.deadline is not None:
        yield (
            f"no detectors that together see every frame answer within {alone.deadline.limit_s:g} s over its "
            f"links ({_links(alone, stream)})",
            replace(alone, deadline=None),
        )
    yield (
        "the machines that it reaches have not the memory, even if they are empty",
        replace(alone, machines=_boundless(alone)),
    )
    slowest = max(d.period for d in alone.detectors)
    yield (
        f"{alone.detectors_per_stream} detectors (detectors_per_stream) do not see every frame",
        replace(
            alone, detectors_per_stream=max(alone.detectors_per_stream, min(slowest, len(alone.detectors)))
        ),
    )
    yield (
        f"its detectors do not see every frame with at most {alone.detectors_per_frame} on one "
        "(detectors_per_frame)",
        replace(alone, detectors_per_frame=len(alone.detectors)),
    )


def _no_limit(problem: Problem, stream: str) -> dict[tuple[str, str], float]:
    """Links that are no limit, but still links: an infinite one would be the stream's own site."""
    links = {(stream, site): problem.link(stream, site) for site in problem.sites}
    return {pair: max(bps, _WIDE_BPS) for pair, bps in links.items()}


def _boundless(problem: Problem) -> tuple[MachineLimit, ...]:
    return tuple(replace(m, memory_bytes=math.inf) for m in problem.machines)


def _links(problem: Problem, stream: str) -> str:
    bps = {site: problem.link(stream, site) for site in problem.sites}
    return ", ".join(f"{_mbps(of_site)} to {site}" for site, of_site in bps.items())


def _mbps(bps: float) -> str:
    return "no limit" if math.isinf(bps) else f"{bps / 1e6:g} Mbps" if bps else "none"


def _full(problem: Problem, stream: str, placed: Sequence[Assignment]) -> str:
    """Alone it could be served: what it shares with others are the machines."""
    by_id, room = {d.id: d for d in problem.detectors}, Room(problem)
    for a in placed:
        room.put(by_id[a.detector])
    sites = {site for site in problem.sites if problem.link(stream, site) > 0.0}
    machines = [m for m in problem.machines if m.site in sites]
    served = len({a.stream for a in placed})
    if problem.memory_rule == "one_detector_per_machine":
        free = sum(room.left(m.id) >= 1 for m in machines)
        left = f"{free} of {len(machines)} machines that it reaches run no detector yet"
    else:
        most = max(machines, key=lambda m: room.left(m.id))
        left = f"the most that is free on one that it reaches is {room.left(most.id) / 1e6:g} GB on {most.id}"
    return f"the machines are full with the {served} streams served: {left}"
