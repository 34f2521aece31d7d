"""Runs over three hosts, and what must hold of them."""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path
from typing import Any

from pipeline.mission.prepared import prepare
from tests.chaos_on_ray import JournalWatch, judge
from tests.three_hosts import ROOT, Hosts

DEMO = ROOT / "configs/missions/demo/mission.yaml"
SITES = ("drone-1", "drone-2")
#: nothing of the journal is taken into a checkpoint and removed
WHOLE_JOURNAL = ("--checkpoint-every", "100000")


def ended(process: subprocess.Popen[str]) -> str:
    said, _ = process.communicate(timeout=240)
    assert process.returncode == 0, said
    return said


def flying(hosts: Hosts, mission: Path, out: Path, *more: str) -> subprocess.Popen[str]:
    """A run in real time whose actors have started."""
    process = hosts.searchlight("run", str(mission), "--out", str(out), "--pace", "realtime", *more)
    until = time.monotonic() + 120.0
    while not any("actors started" in p.read_text() for p in out.parent.glob(f".{out.name}.*.log.part")):
        assert time.monotonic() < until, process.communicate(timeout=10)
        assert process.poll() is None, process.communicate()
        time.sleep(0.2)
    return process


def accounted_for(process: subprocess.Popen[str], out: Path) -> dict[str, Any]:
    """The summary of a run that has ended well."""
    ended(process)
    summary = dict(json.loads((out / "summary.json").read_text(encoding="utf-8")))
    assert summary["partial"] is None
    for stream in summary["streams"]:
        assert stream["captured"] == stream["processed"] + sum(stream["dropped"].values())
        assert stream["processed"] > 0
    return summary


def judged(
    process: subprocess.Popen[str], out: Path, watch: JournalWatch, kept: Path, mission: Path
) -> dict[str, Any]:
    """The summary of a run that ended well and whose map is, to the byte, that of its journal."""
    summary = accounted_for(process, out)
    watch.end()
    judge(prepare(mission), out, summary, kept)
    return summary
