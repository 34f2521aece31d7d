"""Each thing that can be wrong with a mission is one line: where, what was found, what would be right."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio

from actors.cli import main

ROOT = Path(__file__).resolve().parents[2]


def replace(name: str, old: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text, f"{old!r} is not in {name}"
        (folder / name).write_text(text.replace(old, new, 1))

    return change


def truncate_video(folder: Path) -> None:
    video = folder / "drone-1.mp4"
    video.write_bytes(video.read_bytes()[: video.stat().st_size // 2])


def shorten_telemetry(folder: Path) -> None:
    track = folder / "drone-1.srt"
    blocks = track.read_text().split("\n\n")
    track.write_text("\n\n".join(blocks[: len(blocks) // 2]) + "\n\n")


def delay_telemetry(folder: Path) -> None:
    track = folder / "drone-1.srt"
    track.write_text(track.read_text().replace("00:00:", "01:00:"))


def strip_crs(folder: Path) -> None:
    with rasterio.open(folder / "terrain.tif") as source:
        profile, heights = source.profile, source.read()
    profile.update(crs=None)
    with rasterio.open(folder / "terrain.tif", "w", **profile) as target:
        target.write(heights)


def move_terrain(folder: Path) -> None:
    with rasterio.open(folder / "terrain.tif") as source:
        profile, heights = source.profile, source.read()
    profile.update(transform=rasterio.Affine.translation(500.0, 0.0) * profile["transform"])
    with rasterio.open(folder / "terrain.tif", "w", **profile) as target:
        target.write(heights)


def lift_terrain(folder: Path) -> None:
    with rasterio.open(folder / "terrain.tif", "r+") as target:
        target.write(target.read() + np.float32(100.0))


def not_a_model(folder: Path) -> None:
    (folder / "nano.onnx").write_bytes(b"not a model")
    _use_model(folder, folder / "nano.onnx")


def another_model(folder: Path) -> None:
    shutil.copy(ROOT / "tests/data/identity.onnx", folder / "other.onnx")
    _use_model(folder, folder / "other.onnx")


def _use_model(folder: Path, model: Path) -> None:
    pool = (folder / "pool.yaml").read_text().splitlines()
    line = next(i for i, text in enumerate(pool) if "model:" in text)
    pool[line] = pool[line].split("model:")[0] + f"model: {model}"
    (folder / "pool.yaml").write_text("\n".join(pool) + "\n")


BAD = {
    "missing video": (lambda f: (f / "drone-1.mp4").unlink(), "drone-1.mp4"),
    "truncated video": (truncate_video, "drone-1.mp4"),
    "empty telemetry": (lambda f: (f / "drone-1.srt").write_text(""), "drone-1.srt"),
    "telemetry that ends before the video begins": (delay_telemetry, "drone-1.srt"),
    "unknown key": (replace("mission.yaml", "name:", "colour: red\nname:"), "colour"),
    "wrong unit": (replace("mission.yaml", "meters: 0.5", "seconds: 0.5"), "cell_size"),
    "number without a unit": (replace("inventory.yaml", "{mbps: 6}", "6"), "bandwidth"),
    "text that is not YAML": (replace("mission.yaml", "name:", "name: [\n"), "mission.yaml"),
    "terrain without a CRS": (strip_crs, "CRS"),
    "terrain elsewhere": (move_terrain, "terrain.tif"),
    "terrain above the drone": (lift_terrain, "terrain.tif"),
    "terrain that is no raster": (lambda f: (f / "terrain.tif").write_text("hills"), "terrain.tif"),
    "detector that is not ONNX": (not_a_model, "nano.onnx"),
    "detector of an unknown layout": (another_model, "other.onnx"),
    "missing detector": (lambda f: _use_model(f, f / "absent.onnx"), "absent.onnx"),
    "pool that names only machines that are not there": (
        lambda f: (f / "pool.yaml").write_text(
            (f / "pool.yaml")
            .read_text()
            .replace("workstation", "mainframe")
            .replace("onboard", "mainframe-2")
        ),
        "mainframe",
    ),
    "machine type without times": (
        replace("inventory.yaml", "type: workstation", "type: mainframe"),
        "mainframe",
    ),
    "site that is not there": (replace("mission.yaml", "site: drone-1", "site: nowhere"), "nowhere"),
    "link of an unknown stream": (replace("inventory.yaml", "stream: drone-1", "stream: drone-7"), "drone-7"),
}


BOTH = {"terrain above the drone"}


@pytest.fixture
def mission(small_mission: Path, tmp_path: Path) -> Path:
    """A copy that may be spoiled, with inventory and pool beside it."""
    folder = tmp_path / "mission"
    shutil.copytree(small_mission.parent, folder)
    return folder / small_mission.name


def check(
    mission: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> tuple[int, str]:
    monkeypatch.setattr(sys, "argv", ["searchlight", "check", str(mission)])
    with pytest.raises(SystemExit) as stop:
        main()
    return int(stop.value.code or 0), capsys.readouterr().err


def run_locally(mission: Path, out: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "actors.cli", "run", str(mission), "--out", str(out), "--local"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def test_a_good_mission_passes_the_check(
    mission: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said = check(mission, monkeypatch, capsys)
    assert code == 0, said
    assert "warning" not in said
    assert "usable" in said.splitlines()[-1]


@pytest.mark.parametrize("fault", BAD)
def test_bad_input_is_one_line_and_exit_code_2(
    fault: str, mission: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, named = BAD[fault]
    spoil(mission.parent)
    code, said = check(mission, monkeypatch, capsys)
    assert code == 2, said
    lines = said.splitlines()
    assert "Traceback" not in said
    for line in lines:  # what is wrong for both drones is two lines
        assert line.startswith("error: ")
        assert named in line
        assert "found" in line
        assert "expected" in line
    assert len(lines) == (2 if fault in BOTH else 1), said


def test_all_independent_faults_are_named_at_once(
    mission: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("missing video", "empty telemetry", "number without a unit", "missing detector"):
        BAD[name][0](mission.parent)
    (mission.parent / "drone-2.srt").unlink()
    code, said = check(mission, monkeypatch, capsys)
    assert code == 2
    assert len(said.splitlines()) == 5, said
    for name in ("drone-1.mp4", "drone-1.srt", "drone-2.srt", "bandwidth", "absent.onnx"):
        assert name in said


def test_telemetry_that_ends_early_costs_the_pictures_after_it(
    mission: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shorten_telemetry(mission.parent)
    code, said = check(mission, monkeypatch, capsys)
    assert code == 0
    assert "74 of 150 pictures have no pose" in said


def test_a_mission_that_no_allocation_satisfies_names_the_limits_that_clash(
    mission: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    inventory = mission.parent / "inventory.yaml"
    inventory.write_text(
        inventory.read_text().replace("gigabytes: 2", "megabytes: 1").replace("gigabytes: 8", "megabytes: 1")
    )
    code, said = check(mission, monkeypatch, capsys)
    assert (code, said.count("\n")) == (2, 1), said
    assert "ground-pc" in said or "memory" in said


def test_a_bad_mission_leaves_no_run_directory(mission: Path, tmp_path: Path) -> None:
    truncate_video(mission.parent)
    result = run_locally(mission, tmp_path / "run")
    assert result.returncode == 2
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "run").exists()


def test_a_folder_that_is_not_a_run_directory_is_left_alone(mission: Path, tmp_path: Path) -> None:
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "letter.txt").write_text("dear")
    result = run_locally(mission, tmp_path / "home")
    assert result.returncode == 2
    assert [p.name for p in (tmp_path / "home").iterdir()] == ["letter.txt"]
