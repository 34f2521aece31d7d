"""A mission of any size: streams with a link to one site each, machines for each four of a site's streams."""

from __future__ import annotations

import math

from pipeline.allocation.plan import Assignment
from pipeline.allocation.problem import Detector, MachineLimit, Problem
from pipeline.mission.controller.events import Solved
from pipeline.mission.controller.orders import Solve

RATE_HZ, PER_MACHINE, LINK_BPS, SENT_BPS = 10.0, 4, 6e6, 2e6
_BYTES = 1e6


def load_problem(streams: int, sites: int) -> Problem:
    """Streams go round the sites. Every machine has one detector of period 1, and memory for four streams."""
    names, places = tuple(f"v{k}" for k in range(streams)), tuple(f"s{k}" for k in range(sites))
    machines, detectors = [], []
    links: dict[tuple[str, str], float] = {}
    for k, site in enumerate(places):
        mine = names[k::sites]
        links |= {(stream, site): LINK_BPS for stream in mine}
        for number in range(math.ceil(len(mine) / PER_MACHINE)):
            machine = f"{site}m{number}"
            machines.append(MachineLimit(machine, site, PER_MACHINE * _BYTES))
            accuracy = (0.5, 0.6)
            detectors.append(Detector(f"{machine}:d", "d", machine, site, 1, _BYTES, accuracy, 0.05))
    bitrates_bps = (SENT_BPS / 2.0, SENT_BPS)
    return Problem(names, places, tuple(machines), tuple(detectors), bitrates_bps, links, RATE_HZ, 1, 1, 0.9)


def planned(order: Solve) -> tuple[Solved, ...]:
    """Each stream by the next machine of its site that has room; the solver's own time is another question."""
    room = {d.machine: PER_MACHINE for d in order.problem.detectors}
    at_site: dict[str, list[Detector]] = {}
    for detector in order.problem.detectors:
        at_site.setdefault(detector.site, []).append(detector)
    found = []
    for stream, site in order.problem.link_bps:
        free = next((d for d in at_site.get(site, []) if room[d.machine]), None)
        if free is not None:
            room[free.machine] -= 1
            found.append(Assignment(stream, free.id, free.detector, free.machine, site, 1, 0, SENT_BPS))
    return (Solved(order.request, tuple(found), ()),)
