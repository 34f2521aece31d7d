"""A run in real time loses its actors one after the other, and goes on."""

from __future__ import annotations

import json
import signal
import time
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from pipeline.logs import ACTOR_LOGS
from pipeline.mission.controller_log import CONTROLLER_LOG, replayed
from pipeline.mission.operator import ask
from pipeline.mission.prepared import prepare
from pipeline.mission.status import run_status
from tests.chaos_on_ray import chaotic_run
from tests.live_runs import LiveRun, is_accounted_for

ROOT = Path(__file__).resolve().parents[2]
#: side of the square that is searched in the end
AREA_M = 20.0
DEMO = ROOT / "configs/missions/demo/mission.yaml"

pytestmark = [pytest.mark.ray, pytest.mark.timeout(400)]


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
    sockets = run.listening()
    assert {name for name in sockets.values() if name.startswith("ray::")} >= {
        "ray::MachineAct",
        "ray::ReducerAct",
    }
    assert {host for host, _ in sockets} == {"127.0.0.1"}, "nothing listens but on loopback"
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
    is_accounted_for(summary)
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
    is_accounted_for(summary)
    _is_replayed(run.out)
    assert (len(summary["truth"]["found"]), summary["truth"]["false"]) == (9, [])


@pytest.mark.parametrize("seed", [1, *(pytest.param(s, marks=pytest.mark.slow) for s in (0, 2))])
def test_all_laws_hold_of_a_run_whose_actors_are_killed_stopped_and_cut_off(
    small_mission: Path, tmp_path: Path, seed: int
) -> None:
    chaotic_run(small_mission, tmp_path / "run", seed)
