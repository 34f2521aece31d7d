"""Injected faults of telemetry: which are noticed, and under which name; and false alarms on clean flights.

    python -m tests.benchmarks.bench_ingest_checks --folder DIR [--judge | --run]

Seeds and magnitudes for development were fixed before the checks were written; those for judging (``--judge``) are
others, and are not looked at while the checks are changed. Flights are rendered once and kept in the folder, and so
are the results of the checks as they are. ``--run``: for what only a run can see, whole runs on flights of other
seeds.
"""

from __future__ import annotations

import argparse
import copy
import hashlib
import json
import math
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pipeline.config.mission import load_mission
from pipeline.config.scenario import load_scenario
from pipeline.errors import InputError
from pipeline.experiments.pose_errors import _disturbed_srt, _flight
from pipeline.geo.frame import LocalFrame
from pipeline.ingest.checks.picture_motion import Motion, MotionParams, picture_motion
from pipeline.ingest.telemetry.dji_srt import read_dji_srt
from pipeline.mission import noticed as noticed_module
from pipeline.mission.local import run_local
from pipeline.mission.noticed import noticed
from pipeline.mission.planning import plan
from pipeline.mission.prepared import prepare
from pipeline.mission.run_directory import write_run_directory
from pipeline.simulation.flight import Flight
from pipeline.simulation.mission_writer import _write_telemetry, write_rehearsal
from pipeline.simulation.rehearsal import Rehearsal, rehearse
from pipeline.simulation.srt_writer import dji_srt

ROOT = Path(__file__).resolve().parents[2]
DEVELOPMENT_SEEDS, JUDGING_SEEDS = (2001, 2002, 2003, 2004), (3001, 3002, 3003, 3004)
RUN_SEEDS = (4001, 4002, 4003)
SECONDS, RATE_HZ, HEIGHT_M = 12, 10, 20.0
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
    "orbit": {"area": {"width": {"meters": 40}, "depth": {"meters": 40}}},
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
    """The rendered mission of a pattern and a seed, its telemetry as inexact as that of the paper's drones."""
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
    scenario["flight"] |= {"longest": {"seconds": SECONDS}, "height": {"meters": HEIGHT_M}}
    scenario["recording"]["frame_rate"] = {"hertz": RATE_HZ}
    path = folder / f"{pattern}-{seed}.yaml"
    path.write_text(yaml.safe_dump(scenario), encoding="utf-8")
    rehearsal = rehearsed(path, pattern, seed)
    unfinished = folder / f".{pattern}-{seed}"
    shutil.rmtree(unfinished, ignore_errors=True)
    mission = write_rehearsal(rehearsal, unfinished, progress=lambda *_: None, workers=1)
    for number, stream in enumerate(load_mission(mission).streams):
        rng = np.random.default_rng([seed, number])
        stream.telemetry.file.write_text(_disturbed_srt(stream, rehearsal.frame, rng), encoding="utf-8")
    unfinished.rename(target)
    return target


def rehearsed(scenario: Path, pattern: str, seed: int) -> Rehearsal:
    """The flights as they are flown."""
    rehearsal = rehearse(load_scenario(scenario))
    return rehearsal if pattern != "orbit" else replace(rehearsal, flights=orbits(rehearsal, seed))


def exact_folder(folder: Path, pattern: str, seed: int) -> Path:
    """The same pictures, with telemetry that is exact, as no drone's is but with RTK and a calm gimbal."""
    target = folder / f"exact-{pattern}-{seed}"
    if (target / "mission.yaml").is_file():
        return target
    source = flight_folder(folder, pattern, seed)
    copied(source, target)
    rehearsal = rehearsed(folder / f"{pattern}-{seed}.yaml", pattern, seed)
    for number, flight in enumerate(rehearsal.flights):
        _write_telemetry(target / f"drone-{number + 1}.srt", rehearsal, number, flight)
    return target


def copied(source: Path, folder: Path) -> dict[str, Any]:
    """A copy of a mission, its videos as links; what its file says."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(source, folder, ignore=shutil.ignore_patterns("*.mp4"))
    for video in source.glob("*.mp4"):
        (folder / video.name).symlink_to(video.resolve())
    mission: dict[str, Any] = yaml.safe_load((folder / "mission.yaml").read_text(encoding="utf-8"))
    for key in ("inventory", "pool"):
        mission[key] = str((source / mission[key]).resolve())
    (folder / "mission.yaml").write_text(yaml.safe_dump(mission), encoding="utf-8")
    return mission


def orbits(rehearsal: Rehearsal, seed: int) -> tuple[Flight, ...]:
    """Two drones about one point, at which they look, one each way round."""
    rng = np.random.default_rng([seed, 7])
    times_s = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    flights = []
    for way, radius_m, speed_mps in ((1.0, 20.0, 4.0), (-1.0, 16.0, 3.0)):
        turn = rng.uniform(0.0, 2.0 * math.pi) + way * speed_mps / radius_m * times_s
        east, north = radius_m * np.sin(turn), radius_m * np.cos(turn)
        up = float(rehearsal.scene.ground.height(np.zeros(1), np.zeros(1))[0]) + HEIGHT_M
        pitch = np.full_like(turn, -math.atan2(HEIGHT_M, radius_m))
        angles = np.column_stack([turn + math.pi, pitch, np.zeros_like(turn)])
        flights.append(Flight(times_s, np.column_stack([east, north, np.full_like(turn, up)]), angles))
    return tuple(flights)


def causes(mission: Path, first_only: bool = False) -> list[str]:
    """Causes of all findings that are no assumption, or of those on the first stream's files; of an error its words."""
    try:
        found = noticed(prepare(mission)).findings
    except InputError as error:
        return ["units" if "tenths" in str(error) else str(error)[:60]]
    return [
        f.cause for f in found if f.severity != "assumed" and not (first_only and "drone-1" not in f.where)
    ]


@cache
def _motion(path: Path, duration_s: float, size: tuple[int, int], params: MotionParams) -> Motion:
    return picture_motion(path, duration_s, size, params)


def keep_motions() -> None:
    """A fault is in the telemetry; the pictures of a flight are compared once."""

    def kept(path: Path, duration_s: float, size: tuple[int, int], params: MotionParams, _: int) -> Motion:
        return _motion(path.resolve(), duration_s, size, params)

    noticed_module.picture_motion = kept  # type: ignore[assignment]


class Results:
    """What was found before, by the code as it is now: an interrupted run goes on where it was."""

    def __init__(self, folder: Path) -> None:
        code = hashlib.sha256()
        for path in sorted((ROOT / "pipeline/ingest/checks").glob("*.py")):
            code.update(path.read_bytes())
        self._path = folder / f"results-{code.hexdigest()[:12]}.jsonl"
        lines = self._path.read_text(encoding="utf-8").splitlines() if self._path.is_file() else []
        self._known = {(r[0], r[1]): r[2] for r in map(json.loads, lines)}

    def of(self, flight: str, fault: str, find: Callable[[], list[str]]) -> list[str]:
        """The causes that were found."""
        if (flight, fault) not in self._known:
            self._known[flight, fault] = find()
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps([flight, fault, self._known[flight, fault]]) + "\n")
        return self._known[flight, fault]


def injected(source: Path, change: Change | str, folder: Path) -> Path:
    """A copy of the mission with a fault in its first stream."""
    mission = copied(source, folder)
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


def runs(folder: Path) -> None:
    """Print what ``check`` and ``run`` say of a hover and a grid with faults that boxes and the horizon show."""
    known = faults(judge=False)
    wanted = ["height +35 m", "height +15 m", "pitch sign", "focal length -13 %"]
    for seed in RUN_SEEDS:
        for pattern in ("hover", "grid"):
            source = flight_folder(folder, pattern, seed)
            for fault in ["none", *wanted]:
                change = known[fault][0] if fault != "none" else moved(0.0)
                mission = injected(source, change, folder / "injected-run")
                print(f"{pattern}-{seed} {fault:20}", *_run(mission), sep="; ", flush=True)


def _run(mission: Path) -> list[str]:
    try:
        prepared = noticed(prepare(mission))
    except InputError as error:
        return [f"check: error {error}"]
    seen = [f.cause for f in prepared.findings if f.severity == "warning"]
    finished = run_local(prepared, plan(prepared), lambda *_: None)
    shutil.rmtree(mission.parent / "run", ignore_errors=True)
    summary = write_run_directory(prepared, finished, mission.parent / "run")
    more = [f"{f.cause} ({f.found}; {f.evidence})" for f in summary.findings[len(prepared.findings) :]]
    boxes = {
        stream: sum(n for (s, _), n in finished.reducer.fuser.sizes.items() if s == stream)
        for stream in finished.counts
    }
    return [f"check: {seen}", f"run: {more}", f"sure boxes {boxes}", summary.verdict.kind]


def main() -> None:
    """Print a row for each fault: how often it was noticed, and under which name."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--judge", action="store_true")
    parser.add_argument("--run", action="store_true")
    parser.add_argument("--exact", action="store_true", help="Telemetry without any error but the fault.")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    seeds = JUDGING_SEEDS if options.judge else DEVELOPMENT_SEEDS
    keep_motions()
    if options.run:
        runs(options.folder)
        return
    results = Results(options.folder)
    make = exact_folder if options.exact else flight_folder
    flights = {make(options.folder, p, s).name: make(options.folder, p, s) for s in seeds for p in PATTERNS}
    alarms = {
        name: results.of(name, "none", lambda path=path: causes(path / "mission.yaml"))
        for name, path in flights.items()
    }
    print(f"clean flights: {sum(map(bool, alarms.values()))} false alarms in {len(alarms)}", flush=True)
    for name, found in alarms.items():
        if found:
            print("  ", name, found)
    of_faults = {name: path for name, path in flights.items() if name[-4:] in map(str, seeds[:3])}
    for fault, (change, cause) in faults(options.judge).items():
        rows = []
        for name, path in of_faults.items():
            if change == "exchange" and "hover" in name:
                continue
            found = results.of(
                name,
                fault,
                lambda path=path, change=change: causes(
                    injected(path, change, options.folder / f"injected-{os.getpid()}"), change != "exchange"
                ),
            )
            right = any(cause in f.split("/") for f in found)
            rows.append((name, "right" if right else "other name" if found else "missed", found))
        moving = [how for name, how, _ in rows if "hover" not in name]
        hovers = [how for name, how, _ in rows if "hover" in name]
        counts = [
            {k: of.count(k) for k in ("right", "other name", "missed") if k in of} for of in (moving, hovers)
        ]
        others = "; ".join(
            f"{name} {found}" for name, how, found in rows if how != "right" and "hover" not in name
        )
        print(f"{fault:22} {cause:12} moving {counts[0]}, hovers {counts[1]} {others}", flush=True)


if __name__ == "__main__":
    main()
