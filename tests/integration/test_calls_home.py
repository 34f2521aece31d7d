"""No command calls home: in a network that leads nowhere, nobody asks for a name and nothing is sent outside."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.three_hosts import ROOT, refused
from tests.watched_network import ANSWER, WatchedNetwork, watched_network

DETECTOR = ROOT / "configs/detectors/nano.onnx"

pytestmark = [pytest.mark.ray, pytest.mark.timeout(900)]
if (reason := refused()) is not None:
    pytestmark.append(pytest.mark.skip(reason))


@pytest.fixture
def network(tmp_path: Path) -> Iterator[WatchedNetwork]:
    with watched_network(tmp_path) as watched:
        yield watched


def searchlight(network: WatchedNetwork, home: Path, *arguments: object, fails: bool = False) -> str:
    """Run a command with a home folder of its own, and none of the switches that this machine may have set."""
    quiet = ("ORT_DISABLE_TELEMETRY", "RAY_USAGE_STATS_ENABLED", "DO_NOT_TRACK")
    env = {k: v for k, v in os.environ.items() if k not in quiet} | {"HOME": str(home)}
    home.mkdir(exist_ok=True)
    done = network.run(sys.executable, "-m", "actors", *map(str, arguments), env=env, timeout_s=600.0)
    assert (done.returncode == 0) is not fails, f"{arguments}: {done.stdout}{done.stderr}"
    return done.stdout + done.stderr


@pytest.mark.parametrize(
    ("code", "name", "sends"),
    [
        ("import socket; socket.getaddrinfo('made-up.example', 443)", "made-up.example", False),
        ("import socket; s = socket.socket(); s.settimeout(0.2)\n"
         "try: s.connect(('203.0.113.9', 443))\nexcept OSError: pass", None, True),
        ("import urllib.request\n"
         "try: urllib.request.urlopen('https://other.example/', timeout=0.5)\nexcept OSError: pass",
         "other.example", True),
        (f"import socket; socket.socket(type=socket.SOCK_DGRAM).sendto(b'x', ('{ANSWER}', 9))", None, True),
    ],
)  # fmt: skip
def test_who_does_call_is_seen(network: WatchedNetwork, code: str, name: str | None, sends: bool) -> None:
    assert network.wanted.nothing
    done = network.run(sys.executable, "-c", code)
    assert done.returncode == 0, done.stderr
    assert set(network.wanted.names) == ({name} if name else set())
    assert (network.wanted.packets > 0) is sends


@pytest.mark.slow
def test_a_check_and_a_detector_that_is_looked_at_call_nobody(
    network: WatchedNetwork, small_mission: Path, tmp_path: Path
) -> None:
    searchlight(network, tmp_path / "home", "check", small_mission)
    searchlight(network, tmp_path / "home", "detector", "inspect", DETECTOR)
    assert network.wanted.nothing, network.wanted


@pytest.mark.slow
def test_no_command_calls_home(network: WatchedNetwork, small_mission: Path, tmp_path: Path) -> None:
    """Every command that ends by itself; ``train`` has a network of its own to look at (torch), and no more."""
    home, run, demo = tmp_path / "home", tmp_path / "run", ROOT / "configs/missions/demo/mission.yaml"
    flown = tmp_path / "flown"
    flown.mkdir()
    for name in ("drone-1.mp4", "drone-1.srt", "terrain.tif", "camera.yaml"):
        shutil.copy(small_mission.parent / name, flown)
    commands: tuple[tuple[object, ...], ...] = (
        ("--help",),
        ("check", small_mission),
        ("run", small_mission, "--out", run, "--local"),
        ("run", small_mission, "--out", tmp_path / "ray"),
        ("run", small_mission, "--out", tmp_path / "live", "--pace", "realtime", "--metrics-port", "0"),
        ("status", run),
        ("export", run, "--to", "all", "--out", tmp_path / "exports"),
        ("view", run, "--export-coco", tmp_path / "coco"),
        ("allocate", ROOT / "configs/problems/example.yaml"),
        ("simulate", ROOT / "tests/data/small.yaml", "--out", tmp_path / "simulated"),
        ("init", flown),
        ("detector", "inspect", DETECTOR),
        ("pool", "show", ROOT / "configs/pools/demo.yaml"),
        ("pool", "diff", ROOT / "configs/pools/demo.yaml", ROOT / "configs/pools/demo.yaml"),
        ("experiment", "periods"),
        ("experiment", "allocation", "--quick", "--literal-limit", "0", "--out", tmp_path / "allocation"),
        ("experiment", "1", "--mission", demo, "--out", tmp_path / "experiment"),
        ("demo", "--local", "--out", tmp_path / "demo"),
        ("mission", "stop", run),
    )
    seen = {}
    for command in commands:
        before = network.wanted
        try:
            searchlight(network, home, *command)
        except AssertionError as error:  # a command that refuses its input says nothing outside either
            seen[command] = str(error)[-300:]
        assert network.wanted == before, f"{command}: {network.wanted}"
    assert set(seen) == {("mission", "stop", run)}, seen
    written = sorted(str(p.relative_to(home)) for p in home.rglob("*") if p.is_file())
    assert not [name for name in written if "device" in name.lower() or "telemetry" in name.lower()], written
