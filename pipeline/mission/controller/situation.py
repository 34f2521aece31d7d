"""The allocation problem of this moment: the inventory less what is lost, with links as they are measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

from pipeline.allocation.problem import Problem
from pipeline.mission.controller.state import MissionState


@dataclass(frozen=True)
class Situation:
    """What a plan depends on beside the inventory; two equal ones have the same best plan.

    machines: that are up, or work on behind a radio that is away. barred: detectors that broke too often. links:
    stream, site, bit/s.
    """

    streams: tuple[str, ...]
    machines: tuple[str, ...]
    barred: tuple[str, ...]
    links: tuple[tuple[str, str, float], ...]


def situation_of(state: MissionState) -> Situation:
    """The situation of a state."""
    streams = tuple(v for v in state.problem.streams if state.streams[v].is_planned_for)
    return Situation(
        streams,
        tuple(m.id for m in state.problem.machines if state.machines[m.id].peer.life in ("up", "away")),
        tuple(sorted(d for d, count in state.failures.items() if count >= state.params.failures)),
        tuple((v, s, link.planned_bps) for (v, s), link in sorted(state.links.items()) if v in streams),
    )


def problem_now(problem: Problem, situation: Situation) -> Problem:
    """The problem with what the situation leaves of it."""
    up, barred = set(situation.machines), set(situation.barred)
    return replace(
        problem,
        streams=situation.streams,
        machines=tuple(m for m in problem.machines if m.id in up),
        detectors=tuple(d for d in problem.detectors if d.machine in up and d.id not in barred),
        link_bps={(stream, site): bps for stream, site, bps in situation.links},
    )
