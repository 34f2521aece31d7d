"""On Ray: a signal to all of its processes, or one of them dead, and the map so far is published and can go on."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from pathlib import Path

import pytest

from tests.e2e.test_run_ends_early import (
    around,
    ended,
    in_session,
    require_good_end,
    require_partial,
    started,
    wait_for_results,
)

pytestmark = [pytest.mark.ray, pytest.mark.timeout(240)]


@pytest.fixture(scope="module")
def whole(small_mission: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("whole") / "run"
    text = ended(process := started(small_mission, "--out", out, "--local"))
    assert process.returncode == 0, text
    return out


def require_resumed(out: Path, whole: Path) -> None:
    text = ended(process := started("--resume", out))
    assert process.returncode == 0, text
    for name in ("saliency.tif", "salient.geojson", "possible.geojson"):
        assert (out / name).read_bytes() == (whole / name).read_bytes(), name
    assert json.loads((out / "summary.json").read_text())["partial"] is None


@pytest.mark.parametrize(
    "number",
    [
        pytest.param(signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param(signal.SIGINT, marks=pytest.mark.slow),
        pytest.param(signal.SIGHUP, marks=pytest.mark.slow),
    ],
)
def test_a_signal_to_every_process_ends_it_in_good_order_and_it_can_go_on(
    small_mission: Path, whole: Path, tmp_path: Path, number: signal.Signals
) -> None:
    out, folders = tmp_path / "run", ray_folders()
    process = started(small_mission, "--out", out)
    wait_for_results(process, out)
    require_good_end(process, out, number, 60.0)
    assert ray_folders() <= folders
    require_resumed(out, whole)


@pytest.mark.slow
def test_a_second_signal_leaves_no_process_and_no_folder(small_mission: Path, tmp_path: Path) -> None:
    out, folders = tmp_path / "run", ray_folders()
    process = started(small_mission, "--out", out)
    wait_for_results(process, out)
    os.kill(process.pid, signal.SIGTERM)
    os.kill(process.pid, signal.SIGINT)
    ended(process, 30.0)
    assert process.returncode > 128
    assert in_session(process) == []
    assert around(out) == []
    assert ray_folders() <= folders


@pytest.mark.parametrize(
    ("actor", "says"),
    [
        pytest.param("ReducerActor", "the reducer died", marks=pytest.mark.slow),
        pytest.param("SourceActor", "the source of drone-", marks=pytest.mark.slow),
        pytest.param("MachineActor", "machine ", marks=pytest.mark.slow),
    ],
)
def test_what_an_actor_that_dies_leaves_is_published_and_it_can_go_on(
    small_mission: Path, whole: Path, tmp_path: Path, actor: str, says: str
) -> None:
    out = tmp_path / "run"
    process = started(small_mission, "--out", out)
    wait_for_results(process, out)
    os.kill(actors_of(process, actor)[0], signal.SIGKILL)
    text = ended(process, 60.0)
    assert process.returncode == 1, text
    assert "Traceback" not in text
    said = json.loads((out / "summary.json").read_text())["partial"]["reason"]
    assert says in said
    require_partial(out, text, said)
    assert in_session(process) == []
    logs = {path.name for path in (out / "logs").iterdir()}
    assert {"reducer.log", "source-drone-1.log", "source-drone-2.log"} <= logs
    assert any(name.startswith("machine-") for name in logs)
    begun = json.loads((out / "logs/reducer.log").read_text().splitlines()[0])
    assert (begun["event"], begun["actor"]) == ("actor begins", "reducer")
    assert any(stream["processed"] for stream in json.loads((out / "summary.json").read_text())["streams"])
    require_resumed(out, whole)


def actors_of(process: subprocess.Popen[str], actor: str) -> list[int]:
    listed = subprocess.run(["ps", "-eo", "pid,sid,args"], capture_output=True, text=True, check=True).stdout
    rows = [line.split(None, 2) for line in listed.splitlines()[1:]]
    return [
        int(pid) for pid, sid, name in rows if sid == str(process.pid) and name.startswith(f"ray::{actor}")
    ]


def ray_folders() -> set[str]:
    return {
        path.name for path in Path("/tmp").glob("searchlight-*") if (path / "session_latest").is_symlink()
    }
