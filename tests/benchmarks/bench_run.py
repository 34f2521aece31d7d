"""A whole run beside two hand-written loops, and what its parts cost. On an idle machine; ratios are of one run.

python -m tests.benchmarks.bench_run [--only loops realtime] [--out FILE.json]

loops: a mission of 15 s of two drones (the demo's, cut), through the command on Ray as fast as it can, and through two
loops of a few lines, a thread for each stream: decode, encode at the plan's bitrate, decode again, detect; the same
files, the same plan, the same sessions. Throughput is of the pictures that were looked at, over the time between
their begin and their end (``seconds`` of ``summary.json``); wall is of the whole command.

realtime: the demo's first 15 s in real time: from the command to the first result in the map, memory of all processes
(proportional set size, which counts shared pages once), hops of the latency. Then four streams of 10 Hz, each looked
at on its own drone, whose links have no limit: what is neither encoding, decoding, detecting nor the watermark's hold.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import yaml

from pipeline.allocation.plan import Plan
from pipeline.mission.local import make_detector, source_params
from pipeline.mission.planning import plan
from pipeline.mission.prepared import PreparedMission, prepare
from pipeline.mission.stages.source import SourceStage
from pipeline.mission.stages.virtual_link import VirtualLink

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "configs/missions/demo"
SECONDS = 15.0
#: drones that look at their own pictures, at what an on-board computer can do
ALONE = """
sites:
{sites}
links: []
"""


def cut(folder: Path) -> Path:
    """The demo's mission, its first seconds only."""
    return _mission(folder, lambda document: None)


def four_alone(folder: Path) -> Path:
    """Four streams of 10 Hz, each looked at on its own drone: no radio."""

    def change(document: dict[str, Any]) -> None:
        first, second = document["streams"]
        document["streams"] = [
            {**stream, "id": f"drone-{k}", "site": f"drone-{k}"}
            for k, stream in enumerate((first, second, first, second), 1)
        ]
        sites = [
            f"  - {{id: drone-{k}, machines: [{{id: computer-{k}, type: onboard, memory: {{gigabytes: 2}}}}]}}"
            for k in range(1, 5)
        ]
        (folder / "inventory.yaml").write_text(ALONE.format(sites="\n".join(sites)), encoding="utf-8")
        document["inventory"] = "inventory.yaml"

    return _mission(folder, change)


def _mission(folder: Path, change: Any) -> Path:
    folder.mkdir(parents=True)
    document = yaml.safe_load((DEMO / "mission.yaml").read_text(encoding="utf-8"))
    for key in ("pool", "inventory", "scenario"):
        if key in document:
            document[key] = str((DEMO / document[key]).resolve())
    for path in DEMO.iterdir():
        if path.name != "mission.yaml":
            (folder / path.name).symlink_to(path)
    for stream in document["streams"]:
        stream["end"] = {"seconds": SECONDS}
    change(document)
    (folder / "mission.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    return folder / "mission.yaml"


def loops(prepared: PreparedMission, chosen: Plan) -> tuple[int, float]:
    """Pictures that were looked at, and seconds: the hand-written loops, a thread for each stream."""
    detectors = {(a.stream, a.detector): make_detector(prepared, a) for a in chosen.assignments}
    looked = dict.fromkeys((s.stream for s in prepared.streams), 0)

    def loop(stream: Any) -> None:
        def look(detector: str, message: Any) -> None:
            detectors[stream.stream, detector].process(message, 0)
            looked[stream.stream] += 1

        links = {site: float("inf") for (name, site) in prepared.problem.link_bps if name == stream.stream}
        source = SourceStage(stream, chosen.assignments, VirtualLink(links, look), source_params(prepared))
        for frame in source.frames():
            source.offer(frame, frame.time_s)

    threads = [threading.Thread(target=loop, args=(stream,)) for stream in prepared.streams]
    begun = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return sum(looked.values()), time.perf_counter() - begun


class Watched:
    """A command, the time that it took, and the most memory of all its processes, MB."""

    def __init__(self, *arguments: object) -> None:
        self.begun_s = time.time()
        begun = time.perf_counter()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "actors.cli", *map(str, arguments)], cwd=ROOT, stdout=subprocess.DEVNULL
        )
        self.memory_mb, self.parts = 0.0, {}
        while self._process.poll() is None:
            parts = self._memory()
            if sum(parts.values()) > self.memory_mb:
                self.memory_mb, self.parts = sum(parts.values()), parts
            time.sleep(0.25)
        self.wall_s = time.perf_counter() - begun
        assert self._process.returncode == 0

    def _memory(self) -> dict[str, float]:
        parts: dict[str, float] = {}
        for process in _with_children(self._process.pid):
            with suppress(OSError):  # it has just ended
                words = (process / "cmdline").read_bytes().split(b"\0")
                name = b" ".join(words[:1]).decode().split("/")[-1]
                kilobytes = re.search(r"^Pss: +(\d+)", (process / "smaps_rollup").read_text(), re.M)
                if kilobytes:
                    parts[name] = parts.get(name, 0.0) + int(kilobytes[1]) / 1e3
        return parts


def _with_children(pid: int) -> list[Path]:
    """A process and all that it has started, as folders of /proc."""
    parent: dict[int, int] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parent[int(stat.parent.name)] = int(stat.read_text().rpartition(")")[2].split()[1])
    family, before = {pid}, set[int]()
    while family != before:
        before, family = family, family | {child for child, of in parent.items() if of in family}
    return [Path(f"/proc/{one}") for one in sorted(family)]


def bench_loops(folder: Path) -> dict[str, Any]:
    """Both in one run, the loops before and after."""
    mission = cut(folder / "cut")
    prepared = prepare(mission)
    chosen = plan(prepared)
    loops(prepared, chosen)  # warm
    first = loops(prepared, chosen)
    run = Watched("run", mission, "--out", folder / "ray", "--pace", "max")
    second = loops(prepared, chosen)
    summary = json.loads((folder / "ray/summary.json").read_text(encoding="utf-8"))
    looked = sum(s["processed"] for s in summary["substreams"])
    seconds = (first[1] + second[1]) / 2.0
    assert looked == first[0] == second[0], (looked, first, second)
    return {
        "looks": looked,
        "loops_s": [round(first[1], 2), round(second[1], 2)],
        "run_s": summary["seconds"],
        "wall_s": round(run.wall_s, 2),
        "throughput_of_the_loops": round(seconds / summary["seconds"], 3),
        "wall_over_loops": round(run.wall_s / seconds, 2),
    }


def bench_realtime(folder: Path) -> dict[str, Any]:
    """From the command to the first result, memory, latency."""
    found: dict[str, Any] = {}
    for name, mission in (
        ("demo", cut(folder / "demo")),
        ("four streams alone", four_alone(folder / "four")),
    ):
        out = folder / f"{name.replace(' ', '-')}-out"
        run = Watched("run", mission, "--out", out, "--pace", "realtime")
        summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
        log = [json.loads(line) for line in (out / "run.log").read_text(encoding="utf-8").splitlines()]
        first = next(e["time"] for e in log if e["event"] == "first result")
        found[name] = {
            "first_result_s": round(datetime.fromisoformat(first).timestamp() - run.begun_s, 2),
            "memory_mb": round(run.memory_mb),
            "memory_by_process_mb": {
                k: round(v) for k, v in sorted(run.parts.items(), key=lambda kv: -kv[1])
            },
            "streams": summary["streams"],
            "latency": {f"{s['stream']} {s['detector']}": s["latency"] for s in summary["substreams"]},
        }
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", choices=("loops", "realtime"), default=["loops", "realtime"])
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    found: dict[str, Any] = {"at": datetime.now(UTC).isoformat(timespec="seconds")}
    with tempfile.TemporaryDirectory() as scratch:
        if "loops" in arguments.only:
            found["loops"] = bench_loops(Path(scratch))
        if "realtime" in arguments.only:
            found["realtime"] = bench_realtime(Path(scratch))
    text = json.dumps(found, indent=1)
    print(text)
    if arguments.out is not None:
        arguments.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
