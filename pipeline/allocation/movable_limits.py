"""The limits of a problem, each as something that could be otherwise: lifted, or moved by a little."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from pipeline.allocation.problem import MachineLimit, Problem

_KBPS, _MEGABYTE = 1e3, 1e6


@dataclass(frozen=True)
class Step:
    """One number of a limit. now: its value, in whole units. most: from here on it limits nothing. set: the
    problem with another value. words: how a value reads.
    """

    now: int
    most: int
    set: Callable[[Problem, int], Problem]
    words: Callable[[int], str]


@dataclass(frozen=True)
class Limit:
    """name: as the user knows it. lift: the problem without it. steps: its numbers; a stream has a link per
    site.
    """

    name: str
    lift: Callable[[Problem], Problem]
    steps: tuple[Step, ...]


def limits(problem: Problem) -> list[Limit]:
    """All limits; the mission's own numbers first, to blame links and machines where these suffice."""
    return [
        _number("detectors_per_frame", problem.detectors_per_frame, max(1, len(problem.detectors))),
        _per_stream(problem),
        *(_links(problem, s) for s in problem.streams if _has_links(problem, s)),
        *(_machine(problem, m) for m in problem.machines),
    ]


def _per_stream(problem: Problem) -> Limit:
    """Lifted, it is as many as the slowest detector's period: so many of any one kind see every frame."""
    slowest = max((d.period for d in problem.detectors), default=1)
    most = max(problem.detectors_per_stream, min(len(problem.detectors), slowest))
    return _number("detectors_per_stream", problem.detectors_per_stream, most)


def _number(field: str, now: int, most: int) -> Limit:
    """A whole number of the problem itself."""

    def to(changed: Problem, value: int) -> Problem:
        numbers: dict[str, Any] = {field: value}
        return replace(changed, **numbers)

    step = Step(now, most, to, lambda value: f"{field} {value}")
    return Limit(f"{field} {now}", lambda problem: to(problem, most), (step,))


def _has_links(problem: Problem, stream: str) -> bool:
    return any(math.isfinite(problem.link(stream, site)) for site in problem.sites)


def _links(problem: Problem, stream: str) -> Limit:
    links = ", ".join(f"{_mbps(problem.link(stream, site))} to {site}" for site in problem.sites)

    def lift(changed: Problem) -> Problem:
        free = {(stream, site): math.inf for site in problem.sites}
        return replace(changed, link_bps={**changed.link_bps, **free})

    return Limit(f"the links of stream {stream} ({links})", lift, tuple(_link_steps(problem, stream)))


def _link_steps(problem: Problem, stream: str) -> Iterator[Step]:
    """In kbps."""
    most = math.ceil(problem.detectors_per_stream * problem.bitrates_bps[-1] / _KBPS)
    for site in problem.sites:
        bandwidth_bps = problem.link(stream, site)
        if math.isfinite(bandwidth_bps):
            yield Step(
                math.floor(bandwidth_bps / _KBPS), most, _link_setter(stream, site), _link_words(stream, site)
            )


def _link_setter(stream: str, site: str) -> Callable[[Problem, int], Problem]:
    def to(changed: Problem, kbps: int) -> Problem:
        return replace(changed, link_bps={**changed.link_bps, (stream, site): kbps * _KBPS})

    return to


def _link_words(stream: str, site: str) -> Callable[[int], str]:
    return lambda kbps: f"a link of {_mbps(kbps * _KBPS)} from stream {stream} to {site}"


def _mbps(bps: float) -> str:
    return "no limit" if math.isinf(bps) else f"{bps / 1e6:g} Mbps" if bps else "none"


def _machine(problem: Problem, machine: MachineLimit) -> Limit:
    def to(changed: Problem, megabytes: float) -> Problem:
        other = replace(machine, memory_bytes=megabytes * _MEGABYTE)
        machines = tuple(other if m.id == machine.id else m for m in changed.machines)
        return replace(changed, machines=machines)

    def lift(changed: Problem) -> Problem:
        return to(changed, math.inf)

    if problem.memory_rule == "one_detector_per_machine":
        return Limit(f"one detector at a time on machine {machine.id} (memory_rule)", lift, ())
    name = f"the memory of machine {machine.id} ({machine.memory_bytes / 1e9:g} GB)"
    if math.isinf(machine.memory_bytes):
        return Limit(name, lift, ())
    here = sum(d.memory_bytes for d in problem.detectors if d.machine == machine.id)
    now = math.floor(machine.memory_bytes / _MEGABYTE)
    most = max(now, math.ceil(here * len(problem.streams) / _MEGABYTE))
    return Limit(name, lift, (Step(now, most, to, lambda mb: f"{mb / 1e3:g} GB on machine {machine.id}"),))
