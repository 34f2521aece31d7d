"""A run that is stopped publishes what it has, marked partial; a run that is killed goes on with --resume."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import rasterio

ROOT = Path(__file__).resolve().parents[2]
MAPS = ("saliency.tif", "salient.geojson", "possible.geojson", "map.state")
LOCAL = ("--local", "--checkpoint-every", "0.3")

pytestmark = pytest.mark.timeout(240)


def started(*arguments: object) -> subprocess.Popen[str]:
    """In a process group of its own, that can be killed as a whole."""
    command = [sys.executable, "-m", "actors", "run", *map(str, arguments)]
    return subprocess.Popen(
        command, cwd=ROOT, start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )


def ended(process: subprocess.Popen[str], within_s: float = 120.0) -> str:
    try:
        return process.communicate(timeout=within_s)[0]
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        raise


def journal_bytes(out: Path) -> int:
    try:
        return sum(path.stat().st_size for path in (out / "journal").glob("*.log"))
    except OSError:  # one was just removed
        return 0


def wait_for_results(process: subprocess.Popen[str], out: Path) -> None:
    """Until there are some results in the journal; each is some 600 bytes."""
    end = time.monotonic() + 60.0
    while journal_bytes(out) < 5000 and process.poll() is None and time.monotonic() < end:
        time.sleep(0.01)
    assert process.poll() is None, ended(process)


def in_session(process: subprocess.Popen[str]) -> list[str]:
    """Processes of a session that are still there."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            rest = entry.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(rest[3]) == process.pid and rest[0] != "Z":
            found.append((entry.parent / "cmdline").read_text())
    return found


def around(out: Path) -> list[str]:
    return sorted(path.name for path in out.parent.iterdir() if path != out)


@pytest.fixture(scope="module")
def whole(small_mission: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("whole") / "run"
    text = ended(process := started(small_mission, "--out", out, "--local"))
    assert process.returncode == 0, text
    return out


def require_partial(out: Path, text: str, reason: str) -> None:
    """Every output says so."""
    summary = json.loads((out / "summary.json").read_text())
    assert summary["partial"]["reason"] == reason
    assert summary["partial"]["cut_off"]
    for cut in summary["partial"]["cut_off"]:
        assert 0.0 <= cut["reached_s"] < cut["length_s"]
    for stream in summary["streams"]:
        assert stream["captured"] == stream["processed"] + sum(stream["dropped"].values())
    sentence = summary["verdict"]["sentence"]
    assert sentence.startswith(f"PARTIAL MAP: {reason} at 20")
    begin = sentence[: sentence.index(";")]
    assert begin in (out / "report.html").read_text()
    assert begin in json.loads((out / "salient.geojson").read_text())["partial"]
    assert begin in json.loads((out / "possible.geojson").read_text())["partial"]
    with rasterio.open(out / "saliency.tif") as source:
        assert begin in source.tags()["PARTIAL"]
    assert begin in " ".join(text.split())
    assert f"--resume {out}" in " ".join(text.split())


def require_good_end(
    process: subprocess.Popen[str], out: Path, number: signal.Signals, limit_s: float
) -> None:
    """Signal a run and all its processes: it publishes what it has, says so, and leaves nothing behind."""
    os.killpg(process.pid, number)
    text = ended(process, limit_s)
    assert process.returncode == 128 + number, text
    assert "Traceback" not in text
    require_partial(out, text, f"stopped by {number.name}")
    assert in_session(process) == []
    assert around(out) == []


@pytest.mark.slow
# SIGINT is one that OR-Tools and Ray like to take for themselves
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_it_in_good_order_and_it_can_go_on(
    small_mission: Path, whole: Path, tmp_path: Path, number: signal.Signals
) -> None:
    out = tmp_path / "run"
    process = started(small_mission, "--out", out, *LOCAL)
    wait_for_results(process, out)
    require_good_end(process, out, number, 30.0)
    text = ended(process := started("--resume", out))
    assert process.returncode == 0, text
    assert [(out / name).read_bytes() for name in MAPS] == [(whole / name).read_bytes() for name in MAPS]
    assert json.loads((out / "summary.json").read_text())["partial"] is None
    assert not (out / "journal").exists()


def test_a_second_signal_ends_it_at_once(small_mission: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    process = started(small_mission, "--out", out, *LOCAL)
    wait_for_results(process, out)
    before = time.monotonic()
    os.kill(process.pid, signal.SIGTERM)
    os.kill(process.pid, signal.SIGINT)  # two of one kind, so quickly, may be one
    ended(process, 30.0)
    assert time.monotonic() - before < 2.0
    assert process.returncode in (128 + signal.SIGINT, 128 + signal.SIGTERM)
    assert not (out / "summary.json").exists()
    assert in_session(process) == []
    assert around(out) == []
    assert (out / "journal" / "run.json").is_file()


def test_before_the_first_frame_there_is_nothing_to_keep(small_mission: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    process = started(small_mission, "--out", out, *LOCAL)
    while not around(out) and process.poll() is None:  # the lock: it has begun
        time.sleep(0.005)
    os.kill(process.pid, signal.SIGINT)
    text = ended(process, 30.0)
    assert process.returncode == 128 + signal.SIGINT, text
    assert "nothing was written" in text
    assert "Traceback" not in text
    assert list(tmp_path.iterdir()) == []


def moments(seed: int) -> Iterator[float]:
    """Seconds after the journal was begun; the whole takes some 3 s."""
    rng = random.Random(seed)
    while True:
        yield rng.uniform(0.0, 1.2)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.slow) for s in range(1, 7))])
def test_killed_three_times_at_random_moments_it_goes_on_to_the_same_map(
    small_mission: Path, whole: Path, tmp_path: Path, seed: int
) -> None:
    out, kills = tmp_path / "run", 0
    arguments: tuple[object, ...] = (small_mission, "--out", out, *LOCAL)
    for moment_s, _ in zip(moments(seed), range(3), strict=False):
        process = started(*arguments)
        known = journal_bytes(out)
        while journal_bytes(out) == known and process.poll() is None:
            time.sleep(0.005)
        time.sleep(moment_s)
        kills += process.poll() is None
        os.killpg(process.pid, signal.SIGKILL)
        ended(process)
        arguments = ("--resume", out, "--checkpoint-every", "0.3")
    assert kills >= 2, "it was over before it could be killed: the moments say nothing"
    refused = ended(process := started(small_mission, "--out", out, *LOCAL))
    assert process.returncode == 2
    assert "--resume" in refused
    text = ended(process := started("--resume", out))
    assert process.returncode == 0, text
    assert [(out / name).read_bytes() for name in MAPS] == [(whole / name).read_bytes() for name in MAPS]
    assert around(out) == []
    assert not (out / "journal").exists()


def test_what_cannot_go_on_is_one_line(whole: Path, tmp_path: Path) -> None:
    for out in (whole, tmp_path):
        text = ended(process := started("--resume", out))
        assert process.returncode == 2
        assert "no run that was cut off" in " ".join(text.split())
        assert "Traceback" not in text
