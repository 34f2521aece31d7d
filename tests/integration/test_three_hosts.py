"""Over three hosts a run gives the map of one process, and a link that is cut costs frames and nothing else."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.three_hosts import ROOT, Hosts, refused, three_hosts

DEMO = ROOT / "configs/missions/demo/mission.yaml"

pytestmark = [pytest.mark.ray, pytest.mark.timeout(400)]
if (reason := refused()) is not None:
    pytestmark.append(pytest.mark.skip(reason))


@pytest.fixture(scope="module")
def hosts() -> Iterator[Hosts]:
    with three_hosts() as joined:
        yield joined


def _ended(process: subprocess.Popen[str]) -> str:
    said, _ = process.communicate(timeout=240)
    assert process.returncode == 0, said
    return said


def _flying(hosts: Hosts, mission: Path, out: Path) -> subprocess.Popen[str]:
    """A run in real time whose actors have started."""
    process = hosts.searchlight("run", str(mission), "--out", str(out), "--pace", "realtime")
    until = time.monotonic() + 120.0
    while not any("actors started" in p.read_text() for p in out.parent.glob(f".{out.name}.*.log.part")):
        assert time.monotonic() < until, process.communicate(timeout=10)
        assert process.poll() is None, process.communicate()
        time.sleep(0.2)
    return process


def _accounted_for(process: subprocess.Popen[str], out: Path) -> dict[str, Any]:
    """The summary of a run that has ended well."""
    _ended(process)
    summary = dict(json.loads((out / "summary.json").read_text(encoding="utf-8")))
    assert summary["partial"] is None
    for stream in summary["streams"]:
        assert stream["captured"] == stream["processed"] + sum(stream["dropped"].values())
        assert stream["processed"] > 0
    return summary


def _cut_off(hosts: Hosts, mission: Path, out: Path, *, after_s: float, for_s: float) -> dict[str, Any]:
    """The summary of a run in real time whose drone-1 was off the network for a while."""
    process = _flying(hosts, mission, out)
    time.sleep(after_s)
    hosts.cut("d1")
    time.sleep(for_s)
    hosts.cut("d1", up=True)
    return _accounted_for(process, out)


def test_over_three_hosts_it_is_the_map_of_one_process(
    hosts: Hosts, small_mission: Path, tmp_path: Path
) -> None:
    _ended(hosts.searchlight("run", str(small_mission), "--out", str(tmp_path / "three")))
    local = [
        sys.executable,
        "-m",
        "actors",
        "run",
        str(small_mission),
        "--out",
        str(tmp_path / "one"),
        "--local",
    ]
    subprocess.run(local, cwd=ROOT, check=True, capture_output=True)
    one, three = (tmp_path / name / "saliency.tif" for name in ("one", "three"))
    assert three.read_bytes() == one.read_bytes()


def test_a_link_that_is_cut_for_5_s_costs_frames_and_every_one_is_accounted_for(
    hosts: Hosts, small_mission: Path, tmp_path: Path
) -> None:
    summary = _cut_off(hosts, small_mission, tmp_path / "run", after_s=2.0, for_s=5.0)
    said = [(entry["what"], entry["subject"]) for entry in summary["timeline"]]
    assert ("lost", "source:drone-1") in said, "it was cut off, and that is said"


@pytest.mark.slow
@pytest.mark.parametrize("rate", ["3mbit", "1mbit", "500kbit"])
def test_a_link_that_becomes_weak_is_planned_around_and_everybody_is_found(
    hosts: Hosts, tmp_path: Path, rate: str
) -> None:
    process = _flying(hosts, DEMO, tmp_path / "run")
    time.sleep(10.0)
    try:
        hosts.weaken("d1", rate)
        summary = _accounted_for(process, tmp_path / "run")
    finally:
        hosts.strengthen("d1")
    assert (len(summary["truth"]["found"]), summary["truth"]["false"]) == (9, [])
    own = next(s for s in summary["substreams"] if s["detector"].startswith("drone-1-computer"))
    assert own["processed"] == own["offered"] > 300


@pytest.mark.slow
def test_a_drone_that_is_cut_off_for_20_s_comes_back_and_nobody_is_made_up(
    hosts: Hosts, tmp_path: Path
) -> None:
    summary = _cut_off(hosts, DEMO, tmp_path / "run", after_s=10.0, for_s=20.0)
    assert summary["truth"]["false"] == []
    said = [(entry["what"], entry["subject"]) for entry in summary["timeline"]]
    assert said.count(("up", "source:drone-1")) == 2
