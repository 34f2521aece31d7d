"""Which substreams each machine should hold, within its memory."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from pipeline.allocation.problem import MemoryRule
from pipeline.mission.controller.state import Known, MissionState
from pipeline.mission.controller.substreams import Opened, Substream


@dataclass(frozen=True)
class Holding:
    """substreams: that the machine should hold. in_the_way: of these, what must go before others have room."""

    substreams: tuple[Opened, ...]
    in_the_way: frozenset[Substream]


def holdings(state: MissionState) -> dict[str, Holding]:
    """What every machine should hold."""
    wanted = {o.key for s in state.streams.values() for o in s.wanted}
    living: dict[str, list[Known]] = {m.id: [] for m in state.problem.machines}
    for known in state.known.values():
        if known.dead is None:
            living[known.opened.machine].append(known)
    memory = {d.id: d.memory_bytes for d in state.problem.detectors}
    rule = state.problem.memory_rule
    return {
        m.id: _holding(living[m.id], wanted, memory, m.memory_bytes, rule) for m in state.problem.machines
    }


def _holding(
    living: Collection[Known],
    wanted: Collection[Substream],
    memory: Mapping[str, float],
    limit_bytes: float,
    rule: MemoryRule,
) -> Holding:
    """First what a source may be sending, then what is wanted, as far as it fits."""
    held: list[Opened] = []
    for known in sorted(living, key=lambda k: (not k.given, k.opened.key)):
        if _fits([*held, known.opened], memory, limit_bytes, rule):
            held.append(known.opened)
    is_short = len(held) < len(living)
    return Holding(tuple(held), frozenset(o.key for o in held if is_short and o.key not in wanted))


def _fits(
    held: Collection[Opened], memory: Mapping[str, float], limit_bytes: float, rule: MemoryRule
) -> bool:
    """Whether there is memory for the networks of these substreams; epochs of one stream share theirs."""
    instances = {opened.key.instance for opened in held}
    if math.isinf(limit_bytes):
        return True
    if rule == "one_detector_per_machine":
        return len(instances) <= 1
    needed = sum(memory[detector] for _, detector in instances)
    return needed <= limit_bytes + _ROUNDING_BYTES * (1 + len(instances))


#: solvers count whole kilobytes
_ROUNDING_BYTES = 1000.0
