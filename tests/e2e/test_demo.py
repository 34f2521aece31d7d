"""The figures of the demo, on the shipped mission and the shipped detectors."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import rasterio
import rasterio.warp

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "configs/missions/demo"

pytestmark = pytest.mark.timeout(600)


@pytest.fixture(scope="module")
def demo_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("demo") / "run"
    command = [
        sys.executable,
        "-m",
        "actors.cli",
        "run",
        str(DEMO / "mission.yaml"),
        "--out",
        str(out),
        "--local",
    ]
    subprocess.run(command, cwd=ROOT, check=True)
    return out


@pytest.fixture(scope="module")
def summary(demo_run: Path) -> dict[str, Any]:
    return dict(json.loads((demo_run / "summary.json").read_text(encoding="utf-8")))


def test_all_nine_people_are_found_and_nobody_else(summary: dict[str, Any]) -> None:
    assert (len(summary["truth"]["found"]), summary["truth"]["missed"], summary["truth"]["false"]) == (
        9,
        [],
        [],
    )


def test_the_mean_position_error_is_below_that_of_the_paper(summary: dict[str, Any]) -> None:
    assert summary["truth"]["mean_distance_m"] <= 0.36


def test_every_frame_is_accounted_for(summary: dict[str, Any]) -> None:
    for stream in summary["streams"]:
        assert stream["captured"] == stream["processed"] + sum(stream["dropped"].values())


def test_the_map_lies_where_the_terrain_lies(demo_run: Path) -> None:
    with rasterio.open(demo_run / "saliency.tif") as saliency, rasterio.open(DEMO / "terrain.tif") as terrain:
        bounds = rasterio.warp.transform_bounds(saliency.crs, terrain.crs, *saliency.bounds)
        west, south, east, north = terrain.bounds
    # of the terrain what the flights can see is mapped, and cells lie askew to its grid
    assert bounds[0] > west - 2.0
    assert bounds[1] > south - 2.0
    assert bounds[2] < east + 2.0
    assert bounds[3] < north + 2.0
    assert (bounds[2] - bounds[0]) * (bounds[3] - bounds[1]) > 0.8 * (east - west) * (north - south)


def test_the_shipped_files_are_small_enough_to_keep() -> None:
    shipped = [*DEMO.rglob("*"), *(ROOT / "configs/detectors").iterdir()]
    assert all(path.stat().st_size < 6_000_000 for path in shipped if path.is_file())
