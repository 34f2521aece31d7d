"""What a large surface model costs: time and peak memory of ``searchlight check`` and ``run`` over it.

python tests/benchmarks/bench_terrain.py [--folder DIR] [--seconds 8] [--only NAME]

The first seconds of the demo's two videos are laid over the demo's own terrain (for comparison), a one-degree tile of
1 arc-second, a tile of 10,012 x 10,012 cells of 1 m, and a model of 5 km x 5 km in cells of 0.5 m, of which one
percent is the search area. About the flights each of them has the demo's heights, elsewhere hills with noise, so that
it does not compress well. Every command runs in a process of its own. The peak is that process's resident memory (of
``check`` and ``run --local``), and the sum over all processes of a run on Ray, shared pages counted once.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import rasterio
import yaml
from rasterio.transform import from_origin
from rasterio.warp import Resampling, reproject

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "configs/missions/demo"
UTM = "EPSG:32633"
#: of the demo's terrain, on UTM
MIDDLE = 533_617.0, 6_473_622.0
#: side of a search area that is one percent of 5 km x 5 km, metres
SEARCHED_M = 500.0


@dataclass(frozen=True)
class Raster:
    """A surface model to be written. origin: of its north-west corner, in units of the CRS, as cell."""

    crs: str
    origin: tuple[float, float]
    cell: float
    size: int


@dataclass(frozen=True)
class Cost:
    """Of a command. cpu_s, alone_mb: of its first process; all_mb: of it and all that it started."""

    wall_s: float
    cpu_s: float
    alone_mb: float
    all_mb: float


RASTERS = {
    "1-arc-second": Raster("EPSG:4326", (15.0, 59.0), 1.0 / 3600.0, 3601),
    "10012": Raster(UTM, (MIDDLE[0] - 4000.0, MIDDLE[1] + 6000.0), 1.0, 10_012),
    "5km-half-metre": Raster(UTM, (MIDDLE[0] - 2300.0, MIDDLE[1] + 2600.0), 0.5, 10_000),
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--only", choices=("demo", *RASTERS))
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("demo", *RASTERS):
            if arguments.only in (None, name):
                _measure(folder, name, arguments.seconds)


def _measure(folder: Path, name: str, seconds: float) -> None:
    terrain = DEMO / "terrain.tif"
    if name != "demo":
        terrain = folder / f"{name}.tif"
        # in a process of its own: a child's peak begins with the memory that its parent has
        writer = get_context("spawn").Process(target=write_model, args=(terrain, RASTERS[name]))
        writer.start()
        writer.join()
    mission = write_mission(folder / name, terrain, seconds, searched=name == "5km-half-metre")
    for _ in range(2):  # the first turn may have to compile and to read from the disk
        _report(name, "check", measured(["check", str(mission)]))
    if name in ("demo", "5km-half-metre"):
        for way in ("--local", "--pace=max"):
            out = folder / f"{name}-{way.strip('-').replace('=', '-')}"
            _report(name, f"run {way}", measured(["run", str(mission), "--out", str(out), way]))
            written = sorted(p.name for p in out.iterdir())
            print(f"  wrote {', '.join(written)}")


def _report(name: str, what: str, cost: Cost) -> None:
    print(
        f"{name}, {what}: {cost.wall_s:.1f} s ({cost.cpu_s:.1f} CPU seconds), {cost.alone_mb:.0f} MB, "
        f"all processes together {cost.all_mb:.0f} MB",
        flush=True,
    )


def write_model(path: Path, raster: Raster) -> None:
    """Hills with noise, the demo's heights about the demo."""
    if path.exists():
        return
    rng = np.random.default_rng(10)
    x = np.linspace(0.0, 40.0, raster.size, dtype=np.float32)
    heights = 112.0 + 6.0 * np.sin(x)[:, None] * np.cos(x)[None, :]
    heights += rng.normal(0.0, 0.2, heights.shape).astype(np.float32)
    transform = from_origin(*raster.origin, raster.cell, raster.cell)
    with rasterio.open(DEMO / "terrain.tif") as demo:
        ours = np.full(heights.shape, np.nan, np.float32)
        reproject(
            demo.read(1), ours, src_transform=demo.transform, src_crs=demo.crs, src_nodata=np.nan,
            dst_transform=transform, dst_crs=raster.crs, dst_nodata=np.nan, resampling=Resampling.average,
        )  # fmt: skip
    known = np.isfinite(ours)
    heights[known] = ours[known]
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": raster.crs, "transform": transform}
    size = {"width": raster.size, "height": raster.size, "tiled": True, "blockxsize": 512, "blockysize": 512}
    with rasterio.open(path, "w", **profile, **size, compress="deflate", predictor=3) as target:
        target.write(heights.astype(np.float32), 1)
    print(f"{path.name}: {raster.size} x {raster.size}, {path.stat().st_size / 1e6:.0f} MB")


def write_mission(folder: Path, terrain: Path, seconds: float, *, searched: bool) -> Path:
    """The demo's mission over another terrain, cut short."""
    folder.mkdir(exist_ok=True)
    mission = yaml.safe_load((DEMO / "mission.yaml").read_text(encoding="utf-8"))
    mission["terrain"] = {"file": str(terrain), "height_datum": "ellipsoid"}
    for stream in mission["streams"]:
        for where, key in ((stream, "video"), (stream["telemetry"], "file"), (stream, "camera")):
            where[key] = str(DEMO / where[key])
        stream["end"] = {"seconds": seconds}
    mission["inventory"] = str(ROOT / "configs/inventories/demo.yaml")
    mission["pool"] = str(ROOT / "configs/pools/demo.yaml")
    del mission["truth"]
    if searched:
        (folder / "area.geojson").write_text(json.dumps(_area()), encoding="utf-8")
        mission["search_area"] = "area.geojson"
    path = folder / "mission.yaml"
    path.write_text(yaml.safe_dump(mission), encoding="utf-8")
    return path


def _area() -> dict[str, object]:
    half_m = SEARCHED_M / 2.0
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * half_m + MIDDLE
    longitude, latitude = rasterio.warp.transform(UTM, "EPSG:4326", corners[:, 0], corners[:, 1])
    return {"type": "Polygon", "coordinates": [list(map(list, zip(longitude, latitude, strict=True)))]}


def measured(command: list[str]) -> Cost:
    """What a command of ours takes. Raises SystemExit if it fails."""
    started = time.perf_counter()
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    process = subprocess.Popen(
        [sys.executable, "-m", "actors", *command],
        env=env,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    watch = _Watch(process.pid)
    watch.start()
    _, status, usage = os.wait4(process.pid, 0)
    wall_s = time.perf_counter() - started
    watch.over.set()
    watch.join()
    if status:
        raise SystemExit(f"{' '.join(command)}: status {status}")
    alone_mb = usage.ru_maxrss / 1000.0
    cpu_s = usage.ru_utime + usage.ru_stime
    return Cost(wall_s, cpu_s, alone_mb, max(alone_mb, watch.most_kb / 1000.0))


class _Watch(threading.Thread):
    """Looks four times a second how much memory a process and its descendants have, shared pages counted once."""

    def __init__(self, pid: int) -> None:
        super().__init__(daemon=True)
        self.over = threading.Event()
        self.most_kb = 0
        self._pid = pid

    def run(self) -> None:
        while not self.over.wait(0.25):
            self.most_kb = max(self.most_kb, sum(map(_proportional_kb, _descendants(self._pid))))


def _descendants(pid: int) -> list[int]:
    found = [pid]
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            children = [int(child) for child in task.read_text().split()]
        except OSError:
            continue
        for child in children:
            found += _descendants(child)
    return found


def _proportional_kb(pid: int) -> int:
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("Pss:")), 0)


if __name__ == "__main__":
    main()
