"""Seeded faults on a real run in real time, and what must hold of it whatever they were.

The laws: the run ends well; every frame is accounted for; the controller's log, played again, gives its orders; the
summary counts as processed what the journal holds; the map is, to the byte, that of the journal's results, and where
none came too late, that of the same results applied one by one in the order of their capture.
"""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pipeline.logs import ACTOR_LOGS
from pipeline.messages import Detections
from pipeline.mission.controller_log import CONTROLLER_LOG, replayed
from pipeline.mission.durable_reducer import DurableReducer
from pipeline.mission.local import make_reducer
from pipeline.mission.prepared import PreparedMission, prepare
from pipeline.mission.run_journal import read_record, resumed_plan
from pipeline.mission.stages.reducer import ReducerStage
from pipeline.outputs.saliency_tif import write_saliency
from tests.live_runs import LiveRun, is_accounted_for

What = Literal["kill", "stop", "reset"]


@dataclass(frozen=True)
class Fault:
    """kill: an actor's process. stop: it, for for_s. reset: the TCP connections that it has with other actors.

    at_s: after the drones have begun.
    """

    at_s: float
    what: What
    actor: str
    for_s: float = 0.0


def draw_faults(seed: int, prepared: PreparedMission, flight_s: float) -> tuple[Fault, ...]:
    """One to three faults in the first two thirds of a flight, ascending."""
    rng = np.random.default_rng(seed)
    actors = [f"machine:{m.id}" for m in prepared.problem.machines]
    actors += [f"source:{s.stream}" for s in prepared.streams]
    actors += ["reducer", "scheduler"]
    faults = []
    for at_s in sorted(rng.uniform(0.0, flight_s * 2.0 / 3.0, int(rng.integers(1, 4)))):
        what: What = ("kill", "stop", "reset")[int(rng.integers(3))]
        for_s = float(rng.uniform(0.3, 6.0)) if what == "stop" else 0.0
        of = actors[:-1] if what == "reset" else actors  # nobody is connected with the scheduler
        faults.append(Fault(round(float(at_s), 2), what, of[int(rng.integers(len(of)))], round(for_s, 2)))
    return tuple(faults)


def chaotic_run(mission: Path, out: Path, seed: int) -> dict[str, Any]:
    """One run under the faults of a seed; what came of it. Raises AssertionError where a law does not hold."""
    prepared = prepare(mission)
    flight_s = max(s.end_s - s.video.start_s for s in prepared.streams)
    faults = draw_faults(seed, prepared, flight_s)
    run = LiveRun(mission, out, ("--checkpoint-every", "100000"))
    try:
        with tempfile.TemporaryDirectory() as folder:
            journal = JournalWatch(out, Path(folder))
            run.wait_for("actors started")
            begun_s = time.monotonic()
            for fault in faults:
                time.sleep(max(0.0, begun_s + fault.at_s - time.monotonic()))
                if not run.is_over:
                    _strike(run, fault)
            summary = run.end()
            journal.end()
            judged = judge(prepared, out, summary, Path(folder))
    finally:
        run.give_up()
    streams = {s["stream"]: {"processed": s["processed"], **s["dropped"]} for s in summary["streams"]}
    timeline = [f"{e['at_s']:.1f} {e['what']} {e['subject']}" for e in summary["timeline"]]
    return {
        "seed": seed,
        "faults": [asdict(f) for f in faults],
        "streams": streams,
        "timeline": timeline,
    } | judged


def _strike(run: LiveRun, fault: Fault) -> None:
    process = run.process_of(fault.actor)
    if process is None:
        return
    with suppress(ProcessLookupError):  # it was struck before, and is being replaced
        if fault.what == "kill":
            os.kill(process, signal.SIGKILL)
        elif fault.what == "reset":
            _reset(process)
        else:
            os.kill(process, signal.SIGSTOP)
            threading.Timer(fault.for_s, _go_on, [process]).start()


def _go_on(process: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(process, signal.SIGCONT)


def _reset(process: int) -> None:
    """Break all connections between one actor's process and those of others (``ss -K``, which needs root)."""
    said = subprocess.run(["ss", "-tnpH", "state", "established"], capture_output=True, text=True, check=True)
    actors = ("ray::Source", "ray::Machine", "ray::Reducer")
    lines = [line.split() for line in said.stdout.splitlines()]
    ours = {line[2]: line for line in lines if len(line) > 4 and any(a in line[4] for a in actors)}
    for local, line in ours.items():
        if f"pid={process}," in line[4] and line[3] in ours:
            host, _, port = local.rpartition(":")
            subprocess.run(
                ["ss", "-K", "-t", "src", host, "sport", "=", f":{port}"], capture_output=True, check=True
            )


class JournalWatch:
    """Keeps a run's journal, which the run removes at its end: the files are opened as they appear."""

    def __init__(self, out: Path, kept: Path) -> None:
        self._out, self._kept, self._over = out, kept, threading.Event()
        self._files: dict[str, Any] = {}
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Copy what they held to the folder ``kept/journal``."""
        self._over.set()
        self._thread.join()
        (self._kept / "journal").mkdir()
        for name, file in self._files.items():
            with file:
                (self._kept / "journal" / name).write_bytes(file.read())

    def _watch(self) -> None:
        while not self._over.wait(0.05):
            for path in (self._out / "journal").glob("*"):
                if path.name not in self._files and path.suffix in (".log", ".json"):
                    with suppress(FileNotFoundError):
                        self._files[path.name] = path.open("rb")


def judge(prepared: PreparedMission, out: Path, summary: dict[str, Any], kept: Path) -> dict[str, Any]:
    """Hold the laws; what was found of them."""
    is_accounted_for(summary, least=0)  # a source may be stopped for all of a short flight
    _, events = replayed(out / ACTOR_LOGS / CONTROLLER_LOG)
    record = read_record(kept)
    results = _Results(prepared, resumed_plan(kept, record))
    durable = DurableReducer(results.stage, kept / "journal", record.fingerprint, 0.0)
    assert durable.cut == (), durable.cut
    durable.finish()
    counted = {s["stream"]: s["processed"] for s in summary["streams"]}
    held = {stream: len(results.stage.frames(stream)) for stream in counted}
    assert counted == held, f"the summary counts {counted}, the journal holds {held}"
    assert _saliency(results.stage, kept) == (out / "saliency.tif").read_bytes(), (
        "another map than the journal's"
    )
    late = results.stage.sequencer.late.total()
    if late == 0:
        assert _saliency(results.in_order(), kept) == (out / "saliency.tif").read_bytes(), "another order"
    return {"late": late, "results": len(results.applied), "controller_events": events}


class _Results:
    """What a stage applies, noted; and the same applied in the order of capture by another one."""

    def __init__(self, prepared: PreparedMission, plan: Any) -> None:
        self._new = lambda: make_reducer(prepared, plan, lateness=True)
        self.stage = self._new()
        self.applied: list[Detections] = []
        apply = self.stage.fuser.apply

        def noted(result: Detections) -> None:
            self.applied.append(result)
            apply(result)

        self.stage.fuser.apply = noted  # type: ignore[method-assign]

    def in_order(self) -> ReducerStage:
        stage = self._new()
        stage.learn(self.stage.opened)
        for result in sorted(self.applied, key=lambda r: (r.time_ns, r.stream, r.detector)):
            stage.fuser.apply(result)
        return stage


def _saliency(stage: ReducerStage, folder: Path) -> bytes:
    write_saliency(folder / "saliency.tif", stage.fuser.map, None)
    return (folder / "saliency.tif").read_bytes()
