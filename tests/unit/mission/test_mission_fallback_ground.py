"""A mission whose surface model ends under the flight: what stands in is printed, and makes places less sure."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import rasterio
import yaml

from pipeline.errors import InputError
from pipeline.mission.local import make_reducer
from pipeline.mission.planning import plan
from pipeline.mission.prepared import prepare, terrain_at


def cut(small_mission: Path, folder: Path, fallback: dict[str, object] | None) -> Path:
    """The mission with a surface model of which the eastern half is unknown."""
    shutil.copytree(small_mission.parent, folder, dirs_exist_ok=True)
    with rasterio.open(folder / "terrain.tif", "r+") as target:
        heights = target.read(1)
        heights[:, heights.shape[1] // 2 :] = np.nan
        target.write(heights, 1)
    mission = yaml.safe_load((folder / "mission.yaml").read_text(encoding="utf-8"))
    if fallback is not None:
        mission["terrain"]["fallback"] = fallback
    (folder / "mission.yaml").write_text(yaml.safe_dump(mission), encoding="utf-8")
    return folder / "mission.yaml"


def test_ground_is_missing_without_a_fallback_and_stated_with_one(
    small_mission: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="under drone-2: found no ground"):
        prepare(cut(small_mission, tmp_path / "without", None))
    prepared = prepare(
        cut(small_mission, tmp_path / "with", {"height": {"meters": 112}, "sd": {"meters": 3}})
    )
    assert not np.isnan(prepared.terrain.heights_m).any()
    (finding,) = [f for f in prepared.findings if f.cause == "terrain_fallback"]
    assert finding.severity == "assumed"
    assert "a plane at 112.0 m stands in for" in finding.found


@pytest.mark.parametrize("sd_m", [3.0, 8.0])
def test_the_reducer_has_the_deviation_of_what_stands_in(
    small_mission: Path, tmp_path: Path, sd_m: float
) -> None:
    path = cut(small_mission, tmp_path / "m", {"height": {"meters": 112}, "sd": {"meters": sd_m}})
    prepared = prepare(path)
    terrain = make_reducer(prepared, plan(prepared), lateness=False).fuser.map.terrain
    assert terrain.extra_sd_m(*terrain.cell(5.0, 0.0)) == sd_m
    assert terrain.extra_sd_m(*terrain.cell(-5.0, 0.0)) == 0.0


def test_a_plane_at_take_off_is_found_again_for_other_cells(small_mission: Path, tmp_path: Path) -> None:
    prepared = prepare(cut(small_mission, tmp_path / "m", {}))
    terrain = terrain_at(prepared, 2.0 * prepared.terrain.cell_m)
    assert terrain.height(20.0, 0.0) == pytest.approx(prepared.terrain.height(20.0, 0.0))
