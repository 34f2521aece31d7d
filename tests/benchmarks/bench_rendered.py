"""Rendered missions, each with exact poses and with those of a plain receiver: people found, and false places.

The demo, the four check scenarios, and six small ones of seeds that nothing was fitted on: one table. The scenarios are
rendered at 10 pictures a second, which is as many as a mission looks at (a third of the work); the demo is as it ships.
The six are 30 m x 28 m with four people. The plain receiver's errors are those of the paper's flight
(``pipeline/experiments/pose_errors.py``: 0.5 m and 1 degree that stay, a clock 0.1 s off, wandering), and the mission
states them; one draw a mission. Found: a place within 2 m of the person, or the person within the place's own 95 %
ellipse where that is at most 5 m long. False: a place that is nobody's.

What is done is kept in the folder and not done again: run it again after it was ended.

Run: python -m tests.benchmarks.bench_rendered --folder DIR [--only NAME ...]
"""

import argparse
import json
import math
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import yaml

from pipeline.experiments.pose_errors import mission_with_pose_errors
from pipeline.geo.frame import LocalFrame

ROOT = Path(__file__).resolve().parents[2]
CHECKS = ("check-a", "check-b", "check-c", "check-d")
#: fixed before the work
SEEDS = (7001, 7002, 7003, 7004, 7005, 7006)
NEAR_M, LONGEST_M, CHI2_95 = 2.0, 5.0, 5.991


def rendered(name: str, folder: Path) -> Path:
    """The mission file of a name, rendered if it was not."""
    if name == "demo":
        return ROOT / "configs/missions/demo/mission.yaml"
    mission = folder / name / "exact" / "mission.yaml"
    if mission.is_file():
        return mission
    base = name if name in CHECKS else "check-a"
    text = (ROOT / f"configs/scenarios/{base}.yaml").read_text(encoding="utf-8")
    scenario = yaml.safe_load(text.replace("../", f"{ROOT}/configs/"))
    scenario["recording"]["frame_rate"] = {"hertz": 10}
    if name not in CHECKS:
        seed = int(name.removeprefix("seed-"))
        scenario |= {"name": name, "seed": seed}
        scenario["area"] = {"width": {"meters": 30}, "depth": {"meters": 28}}
        scenario["people"] |= {"places": 4, "half_hidden": seed % 2}
    (folder / name).mkdir(parents=True, exist_ok=True)
    path = folder / name / "scenario.yaml"
    path.write_text(yaml.safe_dump(scenario, sort_keys=False), encoding="utf-8")
    searchlight("simulate", path, "--out", mission.parent)
    return mission


def judged(mission: Path, run: Path) -> dict:
    """People, those found, false places, places of a person beyond his first, and the mean distance in metres."""
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    truth = yaml.safe_load(mission.read_text(encoding="utf-8"))["truth"]
    features = json.loads((mission.parent / truth).read_text(encoding="utf-8"))["features"]
    lonlat = np.array([f["geometry"]["coordinates"][:2] for f in features])
    frame = LocalFrame(float(lonlat[0, 1]), float(lonlat[0, 0]))
    people = np.stack(frame.enu_from_wgs84(lonlat[:, 1], lonlat[:, 0]), axis=1)
    nearest: dict[int, float] = {}
    false = several = 0
    for place in summary["found"]:
        at = np.stack(
            frame.enu_from_wgs84(np.array([place["latitude_deg"]]), np.array([place["longitude_deg"]])),
            axis=1,
        )
        whose, distance = _person(people - at, place["error_ellipse"])
        if whose is None:
            false += 1
            continue
        several += whose in nearest
        nearest[whose] = min(distance, nearest.get(whose, math.inf))
    return {
        "people": len(people), "found": len(nearest), "false": false, "several": several,
        "possible": _count(summary["possible"]),
        "error_m": round(float(np.mean(list(nearest.values()))), 3) if nearest else None,
    }  # fmt: skip


def _person(offsets: np.ndarray, ellipse: dict) -> tuple[int | None, float]:
    """Whose a place is: index and metres; None, infinity if nobody's."""
    distance = np.hypot(*offsets.T)
    a, b, c = ellipse["covariance_m2"]
    inverse = np.linalg.inv(np.array([[a, b], [b, c]]))
    inside = np.einsum("ni,ij,nj->n", offsets, inverse, offsets) <= CHI2_95
    right = (distance <= NEAR_M) | (inside & (2.0 * ellipse["semi_major_m"] <= LONGEST_M))
    if not right.any():
        return None, math.inf
    whose = int(np.where(right, distance, np.inf).argmin())
    return whose, float(distance[whose])


def _count(value: object) -> int:
    return len(value) if isinstance(value, list) else int(value)  # type: ignore[call-overload]


def searchlight(*arguments: object) -> None:
    """Its words go to a file beside what it makes."""
    subprocess.run(
        [sys.executable, "-m", "actors.cli", *map(str, arguments)], cwd=ROOT, check=True, stdout=sys.stderr
    )


def main() -> None:
    """Measure what was not, and print all that was."""
    arguments = argparse.ArgumentParser()
    arguments.add_argument("--folder", type=Path, required=True)
    arguments.add_argument("--only", nargs="+")
    given = arguments.parse_args()
    names = (*(f"seed-{s}" for s in SEEDS), "demo", *CHECKS)
    kept = given.folder / "results.json"
    rows = json.loads(kept.read_text(encoding="utf-8")) if kept.is_file() else {}
    for number, name in enumerate(names):
        for poses in ("exact", "plain"):
            if f"{name} {poses}" in rows or (given.only and name not in given.only):
                continue
            mission = rendered(name, given.folder)
            if poses == "plain":
                mission = mission_with_pose_errors(mission, given.folder / name / "plain", number)
            run = given.folder / name / f"run-{poses}"
            searchlight("run", mission, "--out", run, "--local")
            rows[f"{name} {poses}"] = judged(mission, run) | {"date": f"{datetime.now(UTC):%Y-%m-%d}"}
            kept.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    _print(rows)


def _print(rows: dict) -> None:
    for key, row in rows.items():
        print(
            f"{key:16} found {row['found']} of {row['people']}, false {row['false']}, again {row['several']},",
            end="",
        )
        print(f" possible {row['possible']}, {row['error_m']} m, {row['date']}")
    for poses in ("exact", "plain"):
        mine = [row for key, row in rows.items() if key.endswith(poses)]
        people, found, false = (sum(row[k] for row in mine) for k in ("people", "found", "false"))
        if mine:
            share, each = found / people, false / len(mine)
            print(
                f"{poses}: {found} of {people} ({share:.2f}), {each:.2f} false a mission, {len(mine)} missions"
            )


if __name__ == "__main__":
    main()
