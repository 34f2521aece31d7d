"""Is a person found whose detections scatter? Over cells, noise of the position, and detectors; and at what price.

One person lies on level ground; a drone flies over at 30 m and 1 m/s, looks straight down, 2.3 pictures a second;
its position wanders (each axis, correlation time 2 s), and the mission states that truly, biases 0. A detector
finds the person in a share of the pictures with a score. Found: exactly one place within 3 m. Beside it the paper's
rule (all uncertainties 0), and the same flights over nobody with clutter: boxes at random places in a share of the
pictures, and five spots that are taken for a person in 70 % of the pictures at score 0.3.

A row of 200 flights takes 5 to 30 s of processor time, all of them about an hour and a half; with --json it goes
on where it was ended.

Run: python -m tests.benchmarks.bench_pose_noise [--flights 200] [--seeds 11 12 13] [--json FILE]
"""

import argparse
import itertools
import json
import math
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from pipeline.config.fusion import Fusion
from pipeline.fusion.fuser import Fuser
from pipeline.fusion.salient import salient_locations
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, Detections

CAMERA = Camera(640, 480, 418.0, 418.0, 320.0, 240.0)
DOWN = enu_from_camera(0.0, -math.pi / 2.0, 0.0)
HEIGHT_M, RATE_HZ, FRAMES, CORRELATION_S = 30.0, 2.3, 50, 2.0
NEAR_M = 3.0
NOISES_M, CELLS_M = (0.0, 0.5, 1.5), (0.25, 0.5, 1.0, 2.0)
DETECTORS = ((1.0, 0.9), (0.75, 0.9), (0.75, 0.6), (0.5, 0.6))
#: share of pictures with a box at a random place, or spots that are taken for a person
CLUTTER = ((0.02, 0), (0.1, 0), (0.0, 5))
#: seeds are fixed before the work
SEEDS = (11, 12, 13)


def fusion(cell_m: float, noise_m: float, *, paper: bool) -> Fusion:
    """As a mission states it. paper: without any width or dependence."""
    meters = ("position_bias", "height_bias", "terrain", "body", "position_noise")
    zero: dict = {key: {"meters": 0.0} for key in meters}
    zero |= {key: {"degrees": 0.0} for key in ("attitude_bias", "attitude_noise")}
    if paper:
        uncertainty = zero | {"box": {"pixels": 0.0}, "cause_time": {"seconds": 0.0}}
    else:
        uncertainty = zero | {"position_noise": {"meters": noise_m}}
    low, high = {"meters": 0.4}, {"meters": 2.2}
    return Fusion.model_validate(
        {
            "cell_size": {"meters": cell_m},
            "significant_point": "center",
            "object_size": {"width_min": low, "width_max": high, "height_min": low, "height_max": high},
            "cluster_distance": {"meters": 2.0},
            "uncertainty": uncertainty,
        }
    )


def fly(rng, params, detector, noise_m, clutter, *, person) -> tuple[int, int, float]:
    """Places within 3 m of the person, other places, and how far the nearest is from the person, metres."""
    places = listed(rng, params, detector, noise_m, clutter, person=person)
    near = sorted(distance for _, distance in places if distance < NEAR_M) if person else []
    return len(near), len(places) - len(near), near[0] if near else math.nan


def listed(rng, params, detector, noise_m, clutter, *, person) -> list[tuple[float, float]]:
    """Of every place of one flight's list: probability, and metres from where the person lies, or would."""
    cell_m = params.cell_size
    cells = round(60.0 / cell_m)
    terrain = Terrain(
        LocalFrame(48.0, 15.0), -30.0, -30.0, cell_m, np.full((cells, cells), 100.0, np.float32)
    )
    fuser = Fuser(terrain, params, {"s": CAMERA}, {"d": 1.0})
    share, score = detector
    stray, fixed = clutter
    at = rng.uniform(-1.0, 1.0, 2)
    spots = rng.uniform(-8.0, 8.0, (fixed, 2))
    kept = math.exp(-1.0 / RATE_HZ / CORRELATION_S)
    error = rng.normal(0.0, 1.0, 2) * noise_m
    for k in range(FRAMES):
        error = kept * error + rng.normal(0.0, 1.0, 2) * noise_m * math.sqrt(1.0 - kept * kept)
        true = np.array([0.0, -11.0 + k / RATE_HZ, 100.0 + HEIGHT_M])
        things = [(at, score)] if person and rng.random() < share else []
        if rng.random() < stray:
            things.append((true[:2] + rng.uniform(-1.0, 1.0, 2) * (20.0, 15.0), score))
        things += [(spot, 0.3) for spot in spots if rng.random() < 0.7]
        fuser.apply(_result(k, true, error, things))
    places = salient_locations(fuser.map, fuser.looks, params)
    return [(q.probability, float(np.hypot(*(q.position_enu[:2] - at)))) for q in places]


def _result(k, true, error, things) -> Detections:
    pose, boxes, scores = CameraPose(true, DOWN), [], []
    for place, score in things:
        u, v = CAMERA.project_enu(np.array([[*place, 100.0]]), pose)[0]
        w, h = 0.7 / HEIGHT_M * CAMERA.fx / 2.0, 1.6 / HEIGHT_M * CAMERA.fx / 2.0
        if w + 3.0 < u < 637.0 - w and h + 3.0 < v < 477.0 - h:
            boxes.append([u - w, v - h, u + w, v + h])
            scores.append(score)
    seen = CameraPose(true + np.array([*error, 0.0]), DOWN)
    count = len(boxes)
    return Detections(
        "s", "d", k, int(k / RATE_HZ * 1e9), seen,
        np.array(boxes).reshape(count, 4), np.array(scores), np.zeros(count, np.int64),
    )  # fmt: skip


def row(case) -> dict:
    """Many flights of one row of the table."""
    noise_m, cell_m, detector, clutter, person, paper, flights, seed = case
    rng = np.random.default_rng([seed, round(noise_m * 10), round(cell_m * 100)])
    params = fusion(cell_m, noise_m, paper=paper)
    got = [fly(rng, params, detector, noise_m, clutter, person=person) for _ in range(flights)]
    near, false, error = (np.array(column) for column in zip(*got, strict=True))
    return {
        "noise_m": noise_m, "cell_m": cell_m, "share": detector[0], "score": detector[1], "stray": clutter[0],
        "spots": clutter[1], "person": person, "rule": "paper" if paper else "width", "seed": seed,
        "found": float((near == 1).mean()), "several": float((near > 1).mean()),
        "false_places": float(false.mean()),
        "error_m": float(np.nanmean(error)) if np.isfinite(error).any() else math.nan,
    }  # fmt: skip


def main() -> None:
    """Measure and print."""
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--flights", type=int, default=200)
    arguments.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    arguments.add_argument("--noises", type=float, nargs="+", default=NOISES_M)
    arguments.add_argument("--json", type=Path, help="rows that are in it are not measured again")
    arguments.add_argument("--workers", type=int, default=2)
    given = arguments.parse_args()
    grid = list(itertools.product(given.noises, CELLS_M))
    cases = [
        (noise, cell, detector, (0.0, 0), True, paper, given.flights, seed)
        for (noise, cell), detector, seed in itertools.product(grid, DETECTORS, given.seeds)
        for paper in (True, False)
    ]
    cases += [
        (noise, cell, DETECTORS[-1], clutter, False, paper, given.flights, seed)
        for (noise, cell), clutter, seed in itertools.product(grid, CLUTTER, given.seeds)
        for paper in (True, False)
    ]
    kept = json.loads(given.json.read_text()) if given.json and given.json.is_file() else {}
    todo = [case for case in cases if str(case) not in kept]
    with ProcessPoolExecutor(given.workers) as pool:
        for case, done in zip(todo, pool.map(row, todo), strict=True):
            kept[str(case)] = done
            if given.json:
                given.json.write_text(json.dumps(kept, indent=1))
    _print([kept[str(case)] for case in cases])


def _print(rows) -> None:
    keys = ("noise_m", "cell_m", "share", "score", "stray", "spots", "person")
    print(
        "noise_m cell_m share score stray spots | found, one place (least of the seeds): paper width |",
        end="",
    )
    print(" error_m: paper width | false places a flight: paper width")
    for key in dict.fromkeys(tuple(r[k] for k in keys) for r in rows):
        mine = [r for r in rows if tuple(r[k] for k in keys) == key]
        both = [[r for r in mine if r["rule"] == rule] for rule in ("paper", "width")]
        found = [min(r["found"] for r in part) for part in both]
        error = [np.nanmean([r["error_m"] for r in part]) for part in both]
        false = [np.mean([r["false_places"] for r in part]) for part in both]
        print(f"{key[0]:7.1f} {key[1]:6.2f} {key[2]:5.2f} {key[3]:5.2f} {key[4]:5.2f} {key[5]:5d} |", end="")
        print(f" {found[0]:5.2f} {found[1]:5.2f} | {error[0]:5.2f} {error[1]:5.2f} |", end="")
        print(f" {false[0]:6.3f} {false[1]:6.3f}")


if __name__ == "__main__":
    main()
