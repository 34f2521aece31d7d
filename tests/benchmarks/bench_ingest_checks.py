"""Injected faults of telemetry: which are noticed, and under which name; and false alarms on clean flights.

    python -m tests.benchmarks.bench_ingest_checks --folder DIR [--judge]

Seeds and magnitudes for development were fixed before the checks were written; those for judging (``--judge``) are
others, and are not looked at while the checks are changed. Flights are rendered once and kept in the folder.
"""

from __future__ import annotations

import argparse
import copy
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pipeline.errors import InputError
from pipeline.experiments.pose_errors import _flight
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.telemetry.dji_srt import read_dji_srt
from pipeline.mission.noticed import noticed
from pipeline.mission.prepared import prepare
from pipeline.simulation.flight import Flight
from pipeline.simulation.mission_writer import simulate
from pipeline.simulation.srt_writer import dji_srt

ROOT = Path(__file__).resolve().parents[2]
DEVELOPMENT_SEEDS, JUDGING_SEEDS = (2001, 2002), (3001, 3002, 3003)
HOVER = {"east": {"meters": 0}, "north": {"meters": -8}, "heading": {"degrees": 0}}
#: what is changed in the small scenario: flights of each pattern
PATTERNS: dict[str, dict[str, Any]] = {
    "grid": {
        "area": {"width": {"meters": 40}, "depth": {"meters": 30}},
        "flight": {"lane_spacing": {"meters": 14}},
    },
    "leg": {
        "area": {"width": {"meters": 24}, "depth": {"meters": 90}},
        "flight": {"lane_spacing": {"meters": 24}},
    },
    "walkers": {"area": {"width": {"meters": 40}, "depth": {"meters": 30}}, "people": {"walkers": 4}},
    "hover": {"flight": {"drones": 1, "hover": HOVER}},
}
Change = Callable[[Flight], Flight]


def moved(up_m: float) -> Change:
    return lambda f: replace(f, positions_enu=f.positions_enu + np.array([0.0, 0.0, up_m]))


def turned(yaw_deg: float) -> Change:
    return lambda f: replace(f, angles_rad=f.angles_rad + np.array([math.radians(yaw_deg), 0.0, 0.0]))


def scaled(yaw: float, pitch: float, roll: float) -> Change:
    return lambda f: replace(f, angles_rad=f.angles_rad * np.array([yaw, pitch, roll]))


def later(seconds: float) -> Change:
    return lambda f: replace(
        f,
        positions_enu=np.stack(
            [np.interp(f.times_s - seconds, f.times_s, p) for p in f.positions_enu.T], axis=1
        ),
        angles_rad=np.stack([np.interp(f.times_s - seconds, f.times_s, a) for a in f.angles_rad.T], axis=1),
    )


def frozen(flight: Flight) -> Flight:
    return replace(flight, positions_enu=np.tile(flight.positions_enu[:1], (len(flight.times_s), 1)))


def faults(judge: bool) -> dict[str, tuple[Change | str, str]]:
    """Fault -> what it does, and the cause that should be named. judge: at other magnitudes."""
    m = 0.85 if judge else 1.0
    return {
        "telemetry exchanged": ("exchange", "exchanged"),
        f"height {35 * m:+.0f} m": (moved(35 * m), "height_off"),
        f"height {15 * m:+.0f} m": (moved(15 * m), "height_off"),
        f"height {5 * m:+.1f} m": (moved(5 * m), "height_off"),
        "pitch sign": (scaled(1.0, -1.0, 1.0), "pitch_sign"),
        f"yaw {180 * m:+.0f}": (turned(180 * m), "heading_off"),
        f"yaw {90 * m:+.0f}": (turned(90 * m), "heading_off"),
        f"yaw {10 * m:+.1f}": (turned(10 * m), "heading_off"),
        f"clock {0.5 * m:.2f} s": (later(0.5 * m), "clock_off"),
        f"clock {1.0 * m:.2f} s": (later(1.0 * m), "clock_off"),
        "frozen position": (frozen, "frozen"),
        "angles x10": (scaled(10.0, 10.0, 10.0), "units"),
        "twice the duration": (lambda f: replace(f, times_s=2.0 * f.times_s), "duration"),
        f"focal length {-13 * m:.0f} %": (f"focal {1.0 - 0.13 * m}", "focal_length"),
    }


def flight_folder(folder: Path, pattern: str, seed: int) -> Path:
    """The rendered mission of a pattern and a seed."""
    target = folder / f"{pattern}-{seed}"
    if (target / "mission.yaml").is_file():
        return target
    text = (ROOT / "tests/data/small.yaml").read_text(encoding="utf-8")
    scenario = yaml.safe_load(text.replace("../../configs", str(ROOT / "configs")))
    for part, change in PATTERNS[pattern].items():
        scenario[part] = scenario[part] | change
    scenario["seed"] = seed
    scenario["people"] |= {"places": 2}
    if pattern == "hover":
        scenario["mission"]["inventory"] = str(ROOT / "configs/inventories/hover.yaml")
    scenario["flight"] |= {"longest": {"seconds": 12}, "height": {"meters": 20}}
    scenario["recording"]["frame_rate"] = {"hertz": 15}
    path = folder / f"{pattern}-{seed}.yaml"
    path.write_text(yaml.safe_dump(scenario), encoding="utf-8")
    simulate(path, target, progress=lambda *_: None)
    return target


def causes(mission: Path) -> list[str]:
    """Causes of all findings that are no assumption; of an error the words that name it."""
    try:
        found = noticed(prepare(mission)).findings
    except InputError as error:
        return ["units" if "tenths" in str(error) else str(error)[:60]]
    return [f.cause for f in found if f.severity != "assumed" and "drone-1" in f.where]


def injected(source: Path, change: Change | str, folder: Path) -> Path:
    """A copy of the mission with a fault in its first stream."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(source, folder, symlinks=True)
    mission = yaml.safe_load((folder / "mission.yaml").read_text(encoding="utf-8"))
    for key in ("inventory", "pool"):
        mission[key] = str((source / mission[key]).resolve())
    streams = mission["streams"]
    if change == "exchange":
        if len(streams) > 1:
            files = [s["telemetry"]["file"] for s in streams]
            streams[0]["telemetry"]["file"], streams[1]["telemetry"]["file"] = files[1], files[0]
    elif isinstance(change, str):
        camera = yaml.safe_load((folder / "camera.yaml").read_text(encoding="utf-8"))
        scale = float(change.split()[1])
        own = copy.deepcopy(camera) | {"fx": camera["fx"] * scale, "fy": camera["fy"] * scale}
        (folder / "camera-1.yaml").write_text(yaml.safe_dump(own), encoding="utf-8")
        streams[0]["camera"] = "camera-1.yaml"
    else:
        path = folder / streams[0]["telemetry"]["file"]
        track = read_dji_srt(path)
        frame = LocalFrame(float(track.latitude_deg[0]), float(track.longitude_deg[0]))
        flight = change(_flight(track, frame))
        start = datetime.fromtimestamp(0, UTC) + timedelta(microseconds=track.start_time_ns // 1000)
        takeoff_m = float(np.median(track.absolute_height_m - track.relative_height_m))
        path.write_text(dji_srt(flight, frame, start, takeoff_m), encoding="utf-8")
    (folder / "mission.yaml").write_text(yaml.safe_dump(mission), encoding="utf-8")
    return folder / "mission.yaml"


def main() -> None:
    """Print a row for each fault: how often it was noticed, and under which name."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--judge", action="store_true")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    seeds = JUDGING_SEEDS if options.judge else DEVELOPMENT_SEEDS
    flights = {(p, s): flight_folder(options.folder, p, s) for s in seeds for p in PATTERNS}
    alarms = {key: causes(path / "mission.yaml") for key, path in flights.items()}
    print(f"clean flights: {sum(map(bool, alarms.values()))} false alarms in {len(alarms)}", flush=True)
    for key, found in alarms.items():
        if found:
            print("  ", key, found)
    for name, (change, cause) in faults(options.judge).items():
        rows = []
        for (pattern, seed), path in flights.items():
            if change == "exchange" and pattern == "hover":
                continue
            found = causes(injected(path, change, options.folder / "injected"))
            right = any(cause in f.split("/") for f in found)
            rows.append((pattern, seed, "right" if right else "other name" if found else "missed", found))
        counts = {k: sum(r[2] == k for r in rows) for k in ("right", "other name", "missed")}
        missed = [f"{p}-{s} {f}" for p, s, how, f in rows if how != "right"]
        print(f"{name:22} {cause:12} {counts} {'; '.join(missed)}", flush=True)


if __name__ == "__main__":
    main()
