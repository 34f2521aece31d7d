"""The demo's flights as each tool's log tells them: its poses, and its people."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pipeline.config.mission import load_mission
from pipeline.ingest.telemetry.dji_srt import read_dji_srt
from pipeline.ingest.track import Track
from pipeline.mission.faults import Faults
from pipeline.mission.prepared import Filmed, read_filmed
from tests.dialects import (
    airdata_csv,
    ardupilot_bin,
    column_table,
    dji_flight_record_csv,
    klv,
    litchi_csv,
    mavlink_tlog,
    ulog,
)

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "configs/missions/demo"
SHARED_CASE = ROOT.parent / "shared/data/cases/telemetry/airdata_demo.csv"
#: writer, what the mission says of it, step of its heights in metres
DIALECTS: dict[str, tuple[Callable[..., None], dict[str, Any], float]] = {
    "airdata": (airdata_csv.write, {}, 0.03),
    "airdata, metres": (partial(airdata_csv.write, unit="meters"), {}, 0.1),
    "litchi": (litchi_csv.write, {"height": "relative"}, 0.1),
    "flight reader": (dji_flight_record_csv.write, {}, 0.03),
    "flight reader, local time": (
        partial(dji_flight_record_csv.write, zone="local"), {"utc_offset": {"hours": 0}}, 0.03,
    ),
    "txtlogtocsv": (partial(dji_flight_record_csv.write, tool="txtlogtocsv"), {}, 0.1),
    "column table": (column_table.write, {"columns": column_table.COLUMNS}, 0.001),
    "misb klv": (partial(klv.write, ground_m=110.0), {}, 0.31),
    "mavlink tlog": (mavlink_tlog.write, {}, 0.001),
    "ardupilot bin": (ardupilot_bin.write, {}, 0.01),
    "px4 ulog": (ulog.write, {}, 0.001),
}  # fmt: skip


def ten_hertz(track: Track) -> Track:
    """Every third sample."""
    arrays = {
        name: value[::3]
        for name in Track.__dataclass_fields__
        if isinstance(value := getattr(track, name), np.ndarray)
    }
    return replace(track, **arrays, end_s=None)


def mission_in(folder: Path, dialect: str) -> Path:
    """The demo with its telemetry in a dialect."""
    write, says, _ = DIALECTS[dialect]
    shutil.copytree(DEMO, folder)
    mission = yaml.safe_load((folder / "mission.yaml").read_text())
    for stream in mission["streams"]:
        track = ten_hertz(read_dji_srt(folder / f"{stream['id']}.srt"))
        write(folder / f"{stream['id']}.csv", track)
        takeoff_m = float((track.absolute_height_m - track.relative_height_m)[0])
        telemetry = {"file": f"{stream['id']}.csv", "height": "absolute", "height_datum": "ellipsoid"}
        stream["telemetry"] = telemetry | says
        if stream["telemetry"]["height"] == "relative":
            stream["telemetry"]["takeoff_height"] = {"meters": takeoff_m}
    for key in ("inventory", "pool"):
        mission[key] = str((DEMO / mission[key]).resolve())
    (folder / "mission.yaml").write_text(yaml.safe_dump(mission))
    return folder / "mission.yaml"


def filmed(mission: Path) -> Filmed:
    return read_filmed(mission, load_mission(mission), Faults())


@pytest.fixture(scope="module")
def theirs() -> Filmed:
    return filmed(DEMO / "mission.yaml")


@pytest.mark.parametrize("dialect", DIALECTS)
def test_every_dialect_gives_the_demos_poses(tmp_path: Path, theirs: Filmed, dialect: str) -> None:
    """To the resolution of its heights, and what the drone flies in half the time between two rows."""
    ours = filmed(mission_in(tmp_path / "demo", dialect))
    assert ours.left_out == {}
    for one, other in zip(ours.streams, theirs.streams, strict=True):
        for time_s in np.arange(0.0, 46.5, 0.7):
            pose, true = one.trajectory.pose(float(time_s)), other.trajectory.pose(float(time_s))
            assert pose is not None
            assert true is not None
            off_m = np.abs(pose.position_enu - true.position_enu)
            assert off_m[:2].max() < 0.1
            assert off_m[2] < 0.6 * DIALECTS[dialect][2] + 0.02
            assert np.abs(pose.enu_from_camera - true.enu_from_camera).max() < 0.01


def test_positions_of_one_log_and_angles_of_another_meet_by_their_dates(
    tmp_path: Path, theirs: Filmed
) -> None:
    """The log of the positions says that the gimbal stood still; paths are relative to the mission's file."""
    path = mission_in(tmp_path / "demo", "airdata")
    mission = yaml.safe_load(path.read_text())
    angles = {
        name: mission_column for name, mission_column in column_table.COLUMNS.items() if "itude" not in name
    }
    del angles["absolute_height"]
    for stream in mission["streams"]:
        track = ten_hertz(read_dji_srt(path.parent / f"{stream['id']}.srt"))
        column_table.write(path.parent / f"{stream['id']}-gimbal.csv", track)
        still = replace(track, pitch_rad=np.zeros_like(track.pitch_rad), yaw_rad=np.ones_like(track.yaw_rad))
        airdata_csv.write(path.parent / f"{stream['id']}.csv", still)
        stream["telemetry"]["angles"] = {"file": f"{stream['id']}-gimbal.csv", "columns": dict(angles)}
    path.write_text(yaml.safe_dump(mission))
    ours = filmed(path)
    for one, other in zip(ours.streams, theirs.streams, strict=True):
        for time_s in np.arange(0.5, 46.0, 1.3):
            pose, true = one.trajectory.pose(float(time_s)), other.trajectory.pose(float(time_s))
            assert pose is not None
            assert true is not None
            assert np.abs(pose.enu_from_camera - true.enu_from_camera).max() < 0.01


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("dialect", DIALECTS)
def test_every_dialect_finds_the_demos_people(tmp_path: Path, dialect: str) -> None:
    mission, out = mission_in(tmp_path / "demo", dialect), tmp_path / "run"
    command = [sys.executable, "-m", "actors.cli", "run", str(mission), "--out", str(out), "--local"]
    subprocess.run(command, cwd=ROOT, check=True)
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert (len(summary["truth"]["found"]), summary["truth"]["false"]) == (9, [])


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.skipif(not SHARED_CASE.exists(), reason="needs ../shared")
def test_the_shared_airdata_log_finds_the_demos_people(tmp_path: Path) -> None:
    """Without a word on its format, its clock or its units."""
    path = mission_in(tmp_path / "demo", "airdata")
    shutil.copy(SHARED_CASE, path.parent / "drone-1.csv")
    command = [
        sys.executable,
        "-m",
        "actors.cli",
        "run",
        str(path),
        "--out",
        str(tmp_path / "run"),
        "--local",
    ]
    subprocess.run(command, cwd=ROOT, check=True)
    summary = json.loads((tmp_path / "run/summary.json").read_text(encoding="utf-8"))
    assert (len(summary["truth"]["found"]), summary["truth"]["false"]) == (9, [])
