"""The command as a newcomer meets it: installed, in odd surroundings."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def searchlight(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "actors", *map(str, arguments)]
    return subprocess.run(
        command,
        cwd=ROOT,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )


def test_the_version_is_the_packages() -> None:
    result = searchlight("--version")
    assert (result.returncode, result.stdout) == (0, f"searchlight {version('searchlight')}\n")


def test_a_mission_is_checked_whatever_is_around_it(small_mission: Path, tmp_path: Path) -> None:
    (tmp_path / "proj.db").write_bytes(b"of another PROJ")
    result = searchlight(
        "check",
        small_mission,
        PROJ_LIB=str(tmp_path),
        PROJ_DATA=str(tmp_path),
        GDAL_DATA=str(tmp_path),
        PYTHONIOENCODING="ascii",
        HOME="/proc/nowhere",
    )
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--out", "/proc/run"], "no place to write"),
        (["--out", "OUT", "--metrics-port", "99999"], "cannot be served"),
    ],
)
def test_what_cannot_be_had_is_told_before_the_run(
    small_mission: Path, tmp_path: Path, arguments: list[str], text: str
) -> None:
    given = [str(tmp_path / "out") if argument == "OUT" else argument for argument in arguments]
    result = searchlight("run", small_mission, *given)
    assert result.returncode == 2
    assert text in result.stderr.replace("\n", " ")
    assert "Traceback" not in result.stderr
    assert not list(tmp_path.iterdir())


def test_the_wheel_holds_the_code_the_templates_and_the_demo(tmp_path: Path) -> None:
    source = tmp_path / "source"
    tracked = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", "."],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if tracked.returncode != 0:
        pytest.skip("not a git checkout: which files belong to the project is not known")
    names = [name for name in tracked.stdout.split("\0") if name and (ROOT / name).is_file()]
    for name in names:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).symlink_to(ROOT / name)
    pip = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "-q",
        "--no-deps",
        "--no-build-isolation",
        "-w",
        str(tmp_path),
    ]
    subprocess.run([*pip, str(source)], check=True, timeout=240, capture_output=True)
    held = set(zipfile.ZipFile(next(tmp_path.glob("*.whl"))).namelist())
    parts = ("pipeline/", "actors/", "configs/")
    wanted = {
        name.replace("configs/", "searchlight_configs/", 1) if name.startswith("configs/") else name
        for name in names
        if name.startswith(parts) and not name.endswith("README.md")
    }
    assert wanted - held == set()
    # unpacked, as pip does it, it finds the demo: its folder is a package without a module
    shutil.unpack_archive(next(tmp_path.glob("*.whl")), tmp_path / "installed", "zip")
    where = "import pipeline.config.shipped as s; print(s.__file__, s.shipped('missions', 'demo'))"
    command = [sys.executable, "-c", where]
    installed = os.environ | {"PYTHONPATH": str(tmp_path / "installed")}
    run = subprocess.run(command, cwd=tmp_path, env=installed, capture_output=True, text=True, check=True)
    code, demo = run.stdout.split()
    assert Path(code).is_relative_to(tmp_path / "installed")
    assert Path(demo) == tmp_path / "installed/searchlight_configs/missions/demo"
    assert (Path(demo) / "mission.yaml").is_file()
