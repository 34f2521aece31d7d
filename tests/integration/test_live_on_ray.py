"""A run in real time loses its actors one after the other, and goes on."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from pipeline.logs import ACTOR_LOGS
from pipeline.mission.controller_log import CONTROLLER_LOG, replayed
from pipeline.mission.operator import ask
from pipeline.mission.prepared import prepare
from pipeline.mission.status import run_status

ROOT = Path(__file__).resolve().parents[2]
#: side of the square that is searched in the end
AREA_M = 20.0
DEMO = ROOT / "configs/missions/demo/mission.yaml"

pytestmark = [pytest.mark.ray, pytest.mark.timeout(400)]


@dataclass
class LiveRun:
    """A run in a process of its own, whose log is read while it goes on."""

    mission: Path
    out: Path
    struck: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        command = [sys.executable, "-m", "actors.cli", "run", str(self.mission), "--out", str(self.out)]
        self._process = subprocess.Popen(
            [*command, "--pace", "realtime"],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    def events(self) -> list[dict[str, object]]:
        """What its log says so far."""
        lines: list[str] = []
        for path in self.out.parent.glob(f".{self.out.name}.*.log.part"):
            lines += path.read_text(encoding="utf-8").splitlines()
        return [json.loads(line) for line in lines if line.endswith("}")]

    def wait_for(self, event: str, subject: str = "", after: int = 0) -> dict[str, object]:
        """The event, once it is there; after: the events before are not looked at."""
        until = time.monotonic() + 120.0
        while time.monotonic() < until and self._process.poll() is None:
            for found in self.events()[after:]:
                if found["event"] == event and found.get("subject", "") == subject:
                    return found
            time.sleep(0.1)
        raise AssertionError(f"no {event} {subject}: {self._process.communicate(timeout=60)[0]}")

    def strike(self, actor: str, number: signal.Signals) -> int:
        """Signal an actor's process; how many events there were before."""
        before = len(self.events())
        os.kill(self._process_of(actor), number)
        return before

    def _process_of(self, actor: str) -> int:
        if actor == "scheduler":  # it does not report itself, but to the controller that it hosts
            return int(subprocess.check_output(["pgrep", "-n", "-f", "^ray::SchedulerActor"]))
        last = [e for e in self.events() if e["event"] == "up" and e["subject"] == actor][-1]
        return int(str(last["detail"]).split()[1])

    def end(self) -> dict[str, object]:
        """Its summary, once it has ended well."""
        said, _ = self._process.communicate(timeout=240)
        assert self._process.returncode == 0, said
        assert "(raylet)" not in said, "who died is said in our words"
        return dict(json.loads((self.out / "summary.json").read_text(encoding="utf-8")))


def _is_accounted_for(summary: dict) -> None:
    assert summary["partial"] is None
    for stream in summary["streams"]:
        assert stream["captured"] == stream["processed"] + sum(stream["dropped"].values())
        assert stream["processed"] > 0
    for substream in summary["substreams"]:
        assert substream["offered"] == substream["processed"] + sum(substream["dropped"].values())


def _is_replayed(out: Path) -> None:
    """The run's own log, played again, gives the orders that were given."""
    state, events = replayed(out / ACTOR_LOGS / CONTROLLER_LOG)
    assert events > 20
    assert all(stream.ended for stream in state.streams.values())


def _drawn(mission: Path, folder: Path) -> Path:
    """A square about the first place that drone-1 has seen, as a team draws it."""
    prepared = prepare(mission)
    pose = prepared.streams[0].trajectory.pose(prepared.streams[0].trajectory.span_s[0])
    east, north, _ = pose.position_enu
    half = AREA_M / 2.0
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]) * half + (east, north)
    latitude, longitude = prepared.frame.wgs84_from_enu(corners[:, 0], corners[:, 1])
    ring = [[float(x), float(y)] for x, y in zip(longitude, latitude, strict=True)]
    path = folder / "drawn.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    return path


def test_a_killed_machine_is_replaced_a_killed_reducer_loses_nothing_and_the_operator_is_heard(
    small_mission: Path, tmp_path: Path
) -> None:
    run = LiveRun(small_mission, tmp_path / "run")
    run.wait_for("actors started")
    time.sleep(2.0)
    said = run_status(run.out, datetime.now(UTC))
    assert said.state == "flies"
    assert all(
        line.startswith(("small flies", "map of", "places", "drone-", "link", "machine ", " "))
        for line in said.lines
    )
    before = run.strike("machine:ground-pc", signal.SIGKILL)
    run.wait_for("lost", "machine:ground-pc", before)
    before = run.strike("reducer", signal.SIGKILL)
    run.wait_for("lost", "reducer", before)
    for what, event in (("pause", "paused"), ("resume", "goes on")):
        before = len(run.events())
        ask(run.out, what, "drone-2")
        run.wait_for(event, "drone-2", before)
    assert "the search area is now" in ask(run.out, "area", None, file=_drawn(small_mission, tmp_path))
    summary = run.end()
    assert summary["coverage"]["wanted_m2"] == pytest.approx(AREA_M * AREA_M, rel=0.1)
    assert "search area" in {entry["what"] for entry in summary["timeline"]}
    _is_accounted_for(summary)
    _is_replayed(run.out)
    said = {(entry["what"], entry["subject"]) for entry in summary["timeline"]}
    for actor in ("machine:ground-pc", "reducer"):
        assert {("lost", actor), ("started again", actor)} <= said
    # what the reducer had acknowledged, and what it had not, it has: no frame is lost on the other drone
    other = next(s for s in summary["streams"] if s["stream"] == "drone-2")
    assert set(other["dropped"]) <= {"not_sampled", "not_assigned"}


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
@pytest.mark.parametrize("actor", ["machine:ground-pc", "source:drone-1", "reducer", "scheduler"])
def test_the_demo_finds_its_nine_people_whoever_is_struck_in_the_middle(
    actor: str, number: signal.Signals, tmp_path: Path
) -> None:
    run = LiveRun(DEMO, tmp_path / "run")
    run.wait_for("actors started")
    time.sleep(15.0)
    before = run.strike(actor, number)
    run.wait_for("lost", actor, before)
    summary = run.end()
    _is_accounted_for(summary)
    _is_replayed(run.out)
    assert (len(summary["truth"]["found"]), summary["truth"]["false"]) == (9, [])
