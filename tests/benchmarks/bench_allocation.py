"""The allocation's figures, side by side in one run; each in a process of its own, for its peak memory.

- speed: ours against the literal model on cells of the paper's tables in which that needs over 30 s and comes
  to an end (asked: 1000 times);
- own: 150 streams, each with links and accuracies of its own, 40 machines (gap 0.1 % in 10 s);
- classes: 1,000 streams in 50 classes on 400 machines (gap 1 % in 30 s);
- again: 50 streams, one link changed, planned again (0.3 s).

Numba is warmed up first: it compiles once and keeps what it compiled. Wall time is what is asked; CPU time is
what it would come to on a machine that does nothing else (all of it is done in one thread).

Run: python tests/benchmarks/bench_allocation.py [--only own] [--cell ilp_eval1a-dps3-v2]
"""

from __future__ import annotations

import argparse
import multiprocessing
import random
import resource
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TypeVar

from pipeline.allocation import decomposed
from pipeline.allocation.problem import Problem
from pipeline.allocation.replan import replan
from pipeline.allocation.validate import validate
from pipeline.experiments.allocation_times import measure, warm_up
from pipeline.experiments.paper_instance import PaperInstance, load_paper_instance
from pipeline.experiments.paper_tables import Cell, cells_named

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
SPEED_CELLS = ("ilp_eval1a-dps2-v2", "ilp_eval1a-dps3-v2")
LINKS_MBPS = (0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0)
REPEATS = 3

Lines = Iterator[str]
T = TypeVar("T")


@dataclass(frozen=True)
class Took:
    """Wall and CPU time."""

    wall_s: float
    cpu_s: float

    def __str__(self) -> str:
        return f"{self.wall_s:.3f} s (CPU {self.cpu_s:.3f} s)"


def timed(function: Callable[[], T]) -> tuple[T, Took]:
    """What the function returns, and how long it took."""
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    result = function()
    return result, Took(time.perf_counter() - wall_s, time.process_time() - cpu_s)


def instance(copies: int) -> PaperInstance:
    """The paper's machines, so many of each of the four types."""
    shipped = load_paper_instance(
        CONFIGS / "pools/paper-allocation.yaml", CONFIGS / "inventories/paper-allocation.yaml"
    )
    sites = tuple(
        site.model_copy(
            update={"machines": tuple(m.model_copy(update={"count": copies}) for m in site.machines)}
        )
        for site in shipped.inventory.sites
    )
    return replace(shipped, inventory=shipped.inventory.model_copy(update={"sites": sites}))


def paper_problem(copies: int, detectors_per_stream: int, streams: int) -> Problem:
    """As in the tables: equal streams, links of 20 Mbps."""
    return instance(copies).problem(Cell("", 20.0, detectors_per_stream, streams, "", ""))


def varied_problem(copies: int, detectors_per_stream: int, streams: int, classes: int, seed: int) -> Problem:
    """Streams of so many classes, each with links of 0.4 to 36 Mbps and accuracies up to 20 % off."""
    rng = random.Random(seed)
    problem = paper_problem(copies, detectors_per_stream, streams)
    accuracy = {d.detector: d.accuracy for d in problem.detectors}
    links = [{s: _link_bps(rng) for s in problem.sites} for _ in range(classes)]
    accuracies = [{name: _varied(rng, row) for name, row in accuracy.items()} for _ in range(classes)]
    of_class = {stream: number % classes for number, stream in enumerate(problem.streams)}
    return replace(
        problem,
        link_bps={(v, s): bps for v, k in of_class.items() for s, bps in links[k].items()},
        stream_accuracy={(v, name): row for v, k in of_class.items() for name, row in accuracies[k].items()},
    )


def _link_bps(rng: random.Random) -> float:
    return rng.choice(LINKS_MBPS) * rng.uniform(0.8, 1.2) * 1e6


def _varied(rng: random.Random, row: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(min(1.0, accuracy * rng.uniform(0.8, 1.2)) for accuracy in row)


def speed(names: tuple[str, ...], literal_limit_s: float) -> Lines:
    """The literal model's time over ours."""
    for cell in cells_named(names):
        result = measure(instance(10), cell, literal_limit_s)
        ours, literal = result.ours, result.literal
        assert literal is not None
        if result.speed_up is None or literal.cpu_seconds is None or ours.cpu_seconds is None:
            yield f"{cell.name}: literal not ended after {literal_limit_s:g} s, ours {ours.seconds:.3f} s"
            continue
        yield (
            f"{cell.name}: literal {Took(literal.seconds, literal.cpu_seconds)}, "
            f"ours {Took(ours.seconds, ours.cpu_seconds)}: {literal.seconds / ours.seconds:.0f} times "
            f"(CPU {result.speed_up:.0f}), same answer: {result.same}"
        )


def to_gap(problem: Problem, gap: float, limit_s: float) -> Lines:
    """Solve until the gap is reached, and once more until the time is over or the gap 0."""
    for gap_limit in (gap, 0.0):
        solve = partial(decomposed.solve, problem, time_limit_s=limit_s, gap_limit=gap_limit)
        plan, took = timed(solve)
        faults = validate(problem, plan)
        found = "no plan" if plan.gap is None else f"objective {plan.objective:.4f}, gap {plan.gap:.4%}"
        yield (
            f"{len(problem.streams)} streams, {len(problem.machines)} machines, "
            f"{problem.detectors_per_stream} detectors per stream, until the gap is {gap_limit:.1%} or "
            f"{limit_s:g} s: {plan.status}, {found}, {took}, {len(faults)} faults"
        )


def own() -> Lines:
    """150 streams that are all different."""
    for detectors_per_stream in (2, 3):
        yield from to_gap(varied_problem(10, detectors_per_stream, 150, 150, seed=1), 1e-3, 10.0)


def classes() -> Lines:
    """1,000 streams in 50 classes."""
    for detectors_per_stream in (2, 3):
        yield from to_gap(varied_problem(100, detectors_per_stream, 1000, 50, seed=2), 1e-2, 30.0)


def again() -> Lines:
    """A used link falls to a tenth, or is lost."""
    kinds = {
        "equal streams": partial(paper_problem, 10),
        "streams of their own": lambda dps, v: varied_problem(10, dps, v, v, seed=1),
    }
    for kind, make in kinds.items():
        for detectors_per_stream in (2, 3, 5):
            problem = make(detectors_per_stream, 50)
            plan, took = timed(partial(decomposed.solve, problem, time_limit_s=60.0))
            yield (
                f"{kind}, {detectors_per_stream} detectors per stream: first plan {plan.status}, "
                f"gap {plan.gap}, {took}"
            )
            for left in (0.1, 0.0) if plan.assignments else ():
                yield _again(problem, plan.assignments, left)


def _again(problem: Problem, running, left: float) -> str:  # type: ignore[no-untyped-def]
    used = running[0].stream, running[0].site
    changed = replace(problem, link_bps={**problem.link_bps, used: problem.link(*used) * left})
    tries = [timed(partial(replan, changed, running, loss=0.01, time_limit_s=10.0)) for _ in range(REPEATS)]
    found, took = min(tries, key=lambda one: one[1].wall_s)
    faults = validate(changed, found.plan)
    return (
        f"  link {'->'.join(used)} at {left:.0%}: {took}, {found.plan.status}, {found.kept} go on, "
        f"{found.ended} end, {found.begun} begin, fewest: {found.fewest}, {len(faults)} faults"
    )


def apart(name: str, figure: Callable[[], Lines]) -> None:
    """Run a figure in a process of its own and print what it says."""
    print(f"{name}:", flush=True)
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_figure, args=(figure, there))
    process.start()
    there.close()
    while (line := here.recv()) is not None:
        print(f"  {line}", flush=True)
    process.join()


def _figure(figure: Callable[[], Lines], reply: Connection) -> None:
    warm_up(instance(10))
    for line in figure():
        reply.send(line)
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
    reply.send(f"peak memory {peak_mb:.0f} MB")
    reply.send(None)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=("speed", "own", "classes", "again"))
    parser.add_argument("--cell", nargs="+", default=SPEED_CELLS, help="for speed, instead of the defaults")
    parser.add_argument("--literal-limit", type=float, default=600.0)
    chosen = parser.parse_args()
    figures: dict[str, Callable[[], Lines]] = {
        "speed": partial(speed, tuple(chosen.cell), chosen.literal_limit),
        "own": own,
        "classes": classes,
        "again": again,
    }
    for name in chosen.only or figures:
        apart(name, figures[name])


if __name__ == "__main__":
    main()
