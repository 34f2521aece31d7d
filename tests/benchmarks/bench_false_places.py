"""Is finding more bought with false places? The paper's rule and that with uncertainty at equal recall.

The flights of ``bench_pose_noise``: one person, found in 75 % of the pictures at score 0.6, and clutter beside him:
boxes of that score at random places in 2 % and 10 % of the pictures, or five fixed spots that are taken for a person
in 70 % of the pictures at score 0.3. Each rule makes its list; a list is read from the most probable place down, to
one probability for all flights of a row. Recall: the share of flights with a place within 3 m of the person above it.
False: places elsewhere above it. Where one rule's whole list finds fewer people than the other's, the other is cut to
the first's recall, or the least above it; so no rule profits from silence.

Run: python -m tests.benchmarks.bench_false_places [--flights 20] [--json FILE]
What is in the file is not done again.
"""

import argparse
import itertools
import json
from pathlib import Path

import numpy as np

from tests.benchmarks.bench_pose_noise import CLUTTER, NEAR_M, NOISES_M, SEEDS, fusion, listed

CELLS_M, DETECTOR = (0.5, 1.0, 2.0), (0.75, 0.6)
Flight = list[tuple[float, float]]


def at_recall(flights: list[Flight], recall: float) -> tuple[float, float]:
    """Recall and false places a flight, of the shortest lists that have this recall; they can have it."""
    best = [max((p for p, d in places if d < NEAR_M), default=0.0) for places in flights]
    needed = round(recall * len(flights))
    cut = sorted(best, reverse=True)[needed - 1] if needed else 2.0
    found = sum(p >= cut for p in best if p > 0.0)
    false = sum(p >= cut and d >= NEAR_M for places in flights for p, d in places)
    return found / len(flights), false / len(flights)


def compared(paper: list[Flight], width: list[Flight]) -> dict:
    """Whole lists, and both at the recall of the one that finds less."""
    whole = [
        (
            sum(any(d < NEAR_M for _, d in places) for places in rule) / len(rule),
            sum(d >= NEAR_M for places in rule for _, d in places) / len(rule),
        )
        for rule in (paper, width)
    ]
    equal = min(whole[0][0], whole[1][0])
    cut = [at_recall(rule, equal) for rule in (paper, width)]
    return {"whole": whole, "recall": equal, "at_recall": cut}


def row(noise_m: float, cell_m: float, clutter: tuple[float, int], flights: int) -> dict:
    """Both rules over the same flights of all seeds."""
    rules = []
    for paper in (True, False):
        params = fusion(cell_m, noise_m, paper=paper)
        made: list[Flight] = []
        for seed in SEEDS:
            rng = np.random.default_rng([seed, round(noise_m * 10), round(cell_m * 100)])
            made += [listed(rng, params, DETECTOR, noise_m, clutter, person=True) for _ in range(flights)]
        rules.append(made)
    return compared(*rules)


def main() -> None:
    """Measure what was not, and print."""
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--flights", type=int, default=20)
    arguments.add_argument("--json", type=Path)
    given = arguments.parse_args()
    done = json.loads(given.json.read_text()) if given.json and given.json.is_file() else {}
    for noise_m, cell_m, clutter in itertools.product(NOISES_M, CELLS_M, CLUTTER):
        key = f"{noise_m:g} m, cells {cell_m:g} m, stray {clutter[0]:g}, spots {clutter[1]}"
        if key not in done:
            done[key] = row(noise_m, cell_m, clutter, given.flights)
            if given.json:
                given.json.write_text(json.dumps(done, indent=1))
        (paper_all, width_all), (paper, width) = done[key]["whole"], done[key]["at_recall"]
        print(f"{key}: whole lists: paper {paper_all[0]:.2f}, {paper_all[1]:.2f} false;", end=" ")
        print(f"width {width_all[0]:.2f}, {width_all[1]:.2f}.", end=" ")
        print(
            f"At recall {done[key]['recall']:.2f}: paper {paper[1]:.2f}, width {width[1]:.2f} false",
            flush=True,
        )


if __name__ == "__main__":
    main()
