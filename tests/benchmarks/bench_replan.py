"""How fast a running mission is planned again: a valid plan at once, and the best one after it.

50 streams of their own (each with links and accuracies of its own) on the paper's 40 machines; the plan that runs is
the optimum before the event. Every event is planned again with ``first_valid`` and with ``plan_again``; the seeds
were fixed before anything was measured. Times are wall clock and CPU of one process; the machine should be idle.

Run: python tests/benchmarks/bench_replan.py [--detectors 3 5] [--seeds 1 2 3] [--limit 2]
"""

from __future__ import annotations

import argparse
import random
from collections.abc import Callable
from dataclasses import replace
from functools import partial

from bench_allocation import Took, instance, timed, varied_problem

from pipeline.allocation import decomposed
from pipeline.allocation.again import first_valid, plan_again
from pipeline.allocation.plan import Assignment
from pipeline.allocation.planned_again import PlannedAgain
from pipeline.allocation.problem import Problem
from pipeline.allocation.validate import validate
from pipeline.experiments.allocation_times import warm_up

STREAMS = 50
LOSS = 0.01

Running = tuple[Assignment, ...]
Event = Callable[[Problem, Running, random.Random], Problem]


def machine_lost(problem: Problem, running: Running, rng: random.Random) -> Problem:
    """One that runs a detector."""
    return _without(problem, {rng.choice(sorted({a.machine for a in running}))})


def site_lost(problem: Problem, running: Running, rng: random.Random) -> Problem:
    """All machines of one site."""
    site = rng.choice(sorted({a.site for a in running}))
    return _without(problem, {m.id for m in problem.machines if m.site == site})


def two_sites_lost(problem: Problem, running: Running, rng: random.Random) -> Problem:
    """All machines but those of one site: not all streams can be served."""
    left = rng.choice(sorted({a.site for a in running}))
    return _without(problem, {m.id for m in problem.machines if m.site != left})


def link_to_a_third(problem: Problem, running: Running, rng: random.Random) -> Problem:
    """Of one stream, to a site that it uses."""
    used = rng.choice(sorted({(a.stream, a.site) for a in running}))
    return replace(problem, link_bps={**problem.link_bps, used: problem.link(*used) / 3.0})


def stream_leaves(problem: Problem, running: Running, rng: random.Random) -> Problem:
    """One of those that run."""
    gone = rng.choice(problem.streams)
    return replace(problem, streams=tuple(v for v in problem.streams if v != gone))


def stream_hopeless(problem: Problem, running: Running, rng: random.Random) -> Problem:
    """The links of one stream fall to 10 kbps: it cannot be served, the others can."""
    lost = rng.choice(problem.streams)
    return replace(problem, link_bps={p: 1e4 if p[0] == lost else bps for p, bps in problem.link_bps.items()})


def _without(problem: Problem, machines: set[str]) -> Problem:
    return replace(
        problem,
        machines=tuple(m for m in problem.machines if m.id not in machines),
        detectors=tuple(d for d in problem.detectors if d.machine not in machines),
    )


EVENTS: dict[str, Event] = {
    "machine lost": machine_lost,
    "site lost": site_lost,
    "two sites lost": two_sites_lost,
    "link to a third": link_to_a_third,
    "stream leaves": stream_leaves,
    "stream hopeless": stream_hopeless,
}


def cases(detectors: int, seed: int) -> list[tuple[str, Problem, Running]]:
    """The name of each event, the problem after it, and the plan that runs."""
    problem = varied_problem(10, detectors, STREAMS, STREAMS, seed=seed)
    running = decomposed.solve(problem, time_limit_s=60.0).assignments
    rng = random.Random(seed)
    found = [(name, event(problem, running, rng), running) for name, event in EVENTS.items()]
    joins = rng.choice(problem.streams)
    others = replace(problem, streams=tuple(v for v in problem.streams if v != joins))
    found.append(("stream joins", problem, decomposed.solve(others, time_limit_s=60.0).assignments))
    return found


def line(name: str, answer: PlannedAgain, took: Took) -> str:
    """What came out."""
    faults = validate(answer.problem, answer.plan)
    proof = "proven" if answer.proven else "not proven"
    return (
        f"    {name}: {took}, {len(answer.problem.streams)} served, {len(answer.kept)} go on, {len(answer.ended)} "
        f"end, {len(answer.begun)} begin, objective {answer.plan.objective:.4f}, gap {answer.gap:.2%}, {proof}, "
        f"{len(faults)} faults"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--detectors", type=int, nargs="+", default=(3, 5))
    parser.add_argument("--seeds", type=int, nargs="+", default=(1, 2, 3))
    parser.add_argument("--limit", type=float, default=2.0, help="seconds, for plan_again")
    chosen = parser.parse_args()
    warm_up(instance(10))
    for detectors in chosen.detectors:
        firsts, seconds, proven = [], [], []
        for seed in chosen.seeds:
            for name, problem, running in cases(detectors, seed):
                print(f"  {detectors} detectors each, seed {seed}, {name}:")
                first, took = timed(partial(first_valid, problem, running))
                firsts.append(took)
                print(line("first_valid", first, took))
                again = partial(plan_again, problem, running, loss=LOSS, time_limit_s=chosen.limit)
                best, took = timed(again)
                seconds.append(took)
                proven.append(best.proven)
                print(line("plan_again ", best, took), flush=True)
        print(
            f"{detectors} detectors each: first_valid at most {worst(firsts)}, plan_again at most "
            f"{worst(seconds)}, {sum(proven)} of {len(proven)} proven",
            flush=True,
        )


def worst(times: list[Took]) -> Took:
    """The longest wall and the longest CPU time."""
    return Took(max(t.wall_s for t in times), max(t.cpu_s for t in times))


if __name__ == "__main__":
    main()
