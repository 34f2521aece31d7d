"""The command ``searchlight simulate-load``."""

from __future__ import annotations

import math
import time

from actors.commands.tables import print_table
from actors.terminal import say
from pipeline.config.mission import load_mission
from pipeline.config.shipped import shipped
from pipeline.mission.load.controller_load import ControllerLoad, controller_load
from pipeline.mission.load.inventory import LINK_BPS, PER_MACHINE, SENT_BPS
from pipeline.mission.load.reducer_load import result_cost_s

#: results that are timed, seconds of a mission that are watched
_RESULTS, _SECONDS = 1000, 2.0
#: a loop of one process keeps up with as much of a core
_FULL = 1.0


def simulate_load(streams: int, sites: int, limit_s: float) -> None:
    """Print what each part of a mission of this size, and of a quarter and half of it, would use."""
    clock = time.process_time
    fusion = load_mission(shipped("missions", "demo", "mission.yaml")).fusion
    cost_s = result_cost_s(fusion, _RESULTS, clock)
    loads = []
    for part in (4, 2, 1):
        count = max(1, streams // part)
        loads.append(controller_load(count, max(1, min(count, sites // part)), _SECONDS, limit_s, clock))
    rows: list[tuple[str, ...]] = [
        ("streams", "sites", "controller, cores", "reducer, cores", "links, share", "results/s", "steps/s")
    ]
    rows.extend(_row(load, cost_s) for load in loads)
    print_table(rows, left=0)
    say(f"a result costs the reducer {cost_s * 1e3:.2f} ms; {PER_MACHINE} streams a machine, each by itself")
    say(_bottleneck([load for load in loads if load.watched_s > 0.0], cost_s))


def _row(load: ControllerLoad, cost_s: float) -> tuple[str, ...]:
    size = (str(load.streams), str(load.sites))
    if not load.watched_s > 0.0:
        return (*size, f"only {load.flying} fly within the time", "", "", "", "")
    reducer = load.results * cost_s
    return (
        *size,
        f"{load.cores:.2f}",
        f"{reducer:.2f}",
        f"{SENT_BPS / LINK_BPS:.2f}",
        f"{load.results:.0f}",
        f"{load.steps:.0f}",
    )


def _bottleneck(loads: list[ControllerLoad], cost_s: float) -> str:
    """Which part of the ground station fills a core first, and at how many streams: a power law through two sizes."""
    if len(loads) < 2:
        return "too few of these sizes could be played within the time to say what is full first"
    a, b = loads[-2:]
    parts = {
        "the controller": (a.cores, b.cores),
        "the reducer": (a.results * cost_s, b.results * cost_s),
    }
    full = {}
    for name, (less, more) in parts.items():
        exponent = math.log(more / less) / math.log(b.streams / a.streams)
        full[name] = b.streams * (_FULL / more) ** (1.0 / exponent)
    first = min(full, key=lambda name: full[name])
    said = ", ".join(f"{name} fills a core at about {count:,.0f} streams" for name, count in full.items())
    return f"{said}; the first bottleneck is {first}"
