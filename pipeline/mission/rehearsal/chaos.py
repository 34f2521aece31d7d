"""Faults drawn from a seed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

Kind = Literal["kill", "stop", "crash", "rate", "down", "cut", "part"]
_KINDS: tuple[Kind, ...] = ("kill", "stop", "crash", "rate", "down", "cut")


@dataclass(frozen=True)
class Fault:
    """kind: ``kill`` and ``stop`` an actor, ``crash`` one detector of a machine, ``rate`` of a link times a factor,
    ``down`` and ``cut`` a link, ``part`` a site from all others: no word and no packet comes through.

    target: an actor's name, ``STREAM>SITE``, or ``site:SITE``. duration_s: of a stop, of a link's trouble, or until a
    machine that was killed can be started again; infinite: for good. number: which detector; or the factor of a rate.
    """

    at_s: float
    kind: Kind
    target: str
    duration_s: float
    number: float = 0.0


@dataclass(frozen=True)
class ChaosParams:
    """rate_hz: faults per second, between begin_s and end_s. for_good: share of killed machines that never return."""

    begin_s: float = 3.0
    end_s: float = 20.0
    rate_hz: float = 0.3
    for_good: float = 0.2
    longest_s: float = 5.0


def draw_faults(
    rng: np.random.Generator,
    machines: tuple[str, ...],
    streams: tuple[str, ...],
    links: tuple[tuple[str, str], ...],
    params: ChaosParams,
) -> tuple[Fault, ...]:
    """Faults in order of time. The last machine may be lost too, for a while."""
    count = rng.poisson(params.rate_hz * (params.end_s - params.begin_s))
    times = np.sort(rng.uniform(params.begin_s, params.end_s, count))
    return tuple(_draw(rng, float(at_s), machines, streams, links, params) for at_s in times)


def _draw(
    rng: np.random.Generator,
    at_s: float,
    machines: tuple[str, ...],
    streams: tuple[str, ...],
    links: tuple[tuple[str, str], ...],
    params: ChaosParams,
) -> Fault:
    kind = _KINDS[rng.choice(len(_KINDS), p=(0.3, 0.25, 0.1, 0.15, 0.1, 0.1))]
    duration_s = float(rng.uniform(0.2, params.longest_s))
    if kind in ("rate", "down", "cut"):
        stream, site = links[rng.integers(len(links))]
        return Fault(at_s, kind, f"{stream}>{site}", duration_s, float(rng.choice((0.5, 0.25, 0.1))))
    actors = [f"machine:{m}" for m in machines]
    if kind != "crash":
        actors += [*(f"source:{v}" for v in streams), "reducer", "scheduler"]
    target = str(rng.choice(actors))
    if kind == "kill" and target.startswith("machine:") and rng.random() < params.for_good:
        duration_s = float("inf")
    return Fault(at_s, kind, target, duration_s, float(rng.integers(8)))
