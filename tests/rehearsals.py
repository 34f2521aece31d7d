"""Small missions for rehearsals, drawn from a seed, and a planner that is quick and valid, if not good."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pipeline.allocation.plan import Assignment
from pipeline.allocation.problem import Detector, MachineLimit, Problem
from pipeline.mission.controller.events import Solved, Unserved
from pipeline.mission.controller.orders import Solve
from pipeline.mission.rehearsal.chaos import ChaosParams, draw_faults
from pipeline.mission.rehearsal.laws import LawParams, breaches
from pipeline.mission.rehearsal.rehearse import NetworkParams, Rehearsal

#: frames of a stream at 10 Hz; faults end at 15 s, the last of their effects at 20 s, and 11 s are given to recover
TICKS, CHAOS, LAWS = 360, ChaosParams(end_s=15.0, rate_hz=0.45), LawParams(quiet_s=31.0)


def quick_plan(order: Solve) -> tuple[Solved, ...]:
    """One plan, and that is final."""
    return (_planned(order),)


def restless_plan(order: Solve) -> tuple[Solved, ...]:
    """A first plan, and then another one, with as many moves as can be had: machines are filled in turn."""
    return replace(_planned(order), final=False), _planned(
        order, order.request % len(order.problem.detectors)
    )


def _planned(order: Solve, turn: int = 0) -> Solved:
    """Stream after stream, all frames of it by detectors of one period, at the best bitrate that its links carry."""
    detectors = order.problem.detectors[turn:] + order.problem.detectors[:turn]
    problem, taken, unserved = replace(order.problem, detectors=detectors), [], []
    memory = {m.id: m.memory_bytes for m in problem.machines}
    for stream in problem.streams:
        found = _serve(problem, stream, memory)
        taken += found
        for a in found:
            memory[a.machine] -= next(d.memory_bytes for d in problem.detectors if d.id == a.detector)
        if not found:
            unserved.append(Unserved(stream, "no machine has room"))
    return Solved(order.request, tuple(taken), tuple(unserved))


def _serve(problem: Problem, stream: str, memory: dict[str, float]) -> list[Assignment]:
    for period in sorted({d.period for d in problem.detectors}):
        link = {site: problem.link(stream, site) for site in problem.sites}
        left, found = dict(memory), []
        for d in problem.detectors:
            rates = [b for b in problem.bitrates_bps if b / period <= link[d.site]]
            if d.period != period or len(found) == period or not rates or left[d.machine] < d.memory_bytes:
                continue
            left[d.machine] -= d.memory_bytes
            link[d.site] -= rates[-1] / period
            phase = len(found)
            found.append(Assignment(stream, d.id, d.detector, d.machine, d.site, period, phase, rates[-1]))
        if len(found) == period:
            return found
    return []


def draw_problem(rng: np.random.Generator) -> Problem:
    """Two to four machines at two sites, one to three streams, a fast network and a slow one."""
    machines, detectors = [], []
    for number in range(int(rng.integers(2, 5))):
        site, machine = ("ground", "van")[number % 2], f"m{number}"
        machines.append(MachineLimit(machine, site, float(rng.choice((1e6, 1e6, 2e6, 4e6)))))
        for name, period in (("fast", 1), ("slow", 2)):
            accuracy = (0.5, 0.6, 0.7)
            detectors.append(
                Detector(f"{machine}:{name}", name, machine, site, period, 1e6, accuracy, 0.05 * period)
            )
    streams = tuple(f"v{number}" for number in range(int(rng.integers(1, 4))))
    links = {(v, site): float(rng.choice((3e6, 6e6))) for v in streams for site in ("ground", "van")}
    bitrates_bps = (5e5, 1e6, 2e6)
    return Problem(
        streams, ("ground", "van"), tuple(machines), tuple(detectors), bitrates_bps, links, 10.0, 3, 2, 0.9
    )


def rehearsed(
    seed: int, chaos: ChaosParams = CHAOS, network: NetworkParams | None = None, **options
) -> Rehearsal:
    """The mission of a seed, played."""
    rng = np.random.default_rng(seed)
    problem = draw_problem(rng)
    machines = tuple(m.id for m in problem.machines)
    faults = draw_faults(rng, machines, problem.streams, tuple(problem.link_bps), chaos)
    rehearsal = Rehearsal(
        problem,
        options.pop("solver", quick_plan),
        ticks=TICKS,
        faults=faults,
        seed=seed,
        network=network,
        **options,
    )
    rehearsal.run(until_s=TICKS / 10.0 + 60.0, note_s=LAWS.judged_s)
    return rehearsal


def broken_laws(seed: int, laws: LawParams = LAWS, **options) -> list[str]:
    """The laws that do not hold of the mission of a seed."""
    return breaches(rehearsed(seed, **options), laws)
