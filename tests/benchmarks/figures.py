"""Every figure of the README, measured here: ``make bench``. Other seeds are rendered first (minutes)."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "configs/missions/demo/mission.yaml"
OTHER_SEEDS = ("check-a", "check-b", "check-c", "check-d")


def searchlight(*arguments: object) -> None:
    """Run the command line; its progress goes to the terminal."""
    subprocess.run([sys.executable, "-m", "actors.cli", *map(str, arguments)], cwd=ROOT, check=True)


def run(mission: Path, out: Path, *options: object) -> str:
    """One mission from files to map; a line with what came out."""
    searchlight("run", mission, "--out", out, *options)
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    truth, streams = summary["truth"], summary["streams"]
    sums = all(s["captured"] == s["processed"] + sum(s["dropped"].values()) for s in streams)
    return (
        f"found {len(truth['found'])} of {truth['people']}, false {len(truth['false'])}, "
        f"mean error {truth['mean_distance_m']:.2f} m; {summary['video_seconds']:.1f} s of video in "
        f"{summary['seconds']:.1f} s; every frame accounted for: {sums}"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "runs/bench")
    parser.add_argument(
        "--demo-only", action="store_true", help="leave out the three other seeds and the 60 s transfer"
    )
    arguments = parser.parse_args()
    out: Path = arguments.out
    lines = [f"demo, Ray, pace max: {run(DEMO, out / 'demo')}"]
    lines.append(f"demo, Ray, pace realtime: {run(DEMO, out / 'demo-realtime', '--pace', 'realtime')}")
    lines.append(f"demo, --local: {run(DEMO, out / 'demo-local', '--local')}")
    same = (out / "demo/saliency.tif").read_bytes() == (out / "demo-local/saliency.tif").read_bytes()
    lines.append(f"saliency.tif of Ray and --local equal: {same}")
    if not arguments.demo_only:
        for name in OTHER_SEEDS:
            mission = out / f"mission-{name}" / "mission.yaml"
            if not mission.is_file():
                searchlight("simulate", ROOT / f"configs/scenarios/{name}.yaml", "--out", mission.parent)
            lines.append(f"{name}: {run(mission, out / name)}")
        for name in ("fusion", "fusion_throughput", "error_ellipse", "link", "allocation", "replan"):
            script = ROOT / f"tests/benchmarks/bench_{name}.py"
            subprocess.run([sys.executable, script], cwd=ROOT, check=True)
    print(*lines, sep="\n")


if __name__ == "__main__":
    main()
