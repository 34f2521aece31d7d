"""The command ``searchlight run``: begin a run or go on with one, and publish what it found, whole or in part."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from actors.commands.people import print_people
from actors.mission import run_on_ray
from actors.nodes import joined
from actors.signals import stopped_by_signals
from actors.source import Pace
from actors.terminal import progress_bars, say
from actors.wiring import RunOptions
from pipeline.allocation.plan import Plan
from pipeline.config.mission import load_mission
from pipeline.errors import InputError, RunFailedError
from pipeline.logs import ACTOR_LOGS, FOLDER_VARIABLE, logged_run
from pipeline.mission.disk_forecast import disk_forecast, require_room
from pipeline.mission.durable_reducer import JournalParams
from pipeline.mission.find_mission import find_mission
from pipeline.mission.flown import as_flown
from pipeline.mission.live_files import begin_live, end_live
from pipeline.mission.local import FinishedRun, run_local
from pipeline.mission.near_files import Near, here
from pipeline.mission.noticed import noticed
from pipeline.mission.onto import read_earlier_run
from pipeline.mission.planning import plan as plan_mission
from pipeline.mission.prepared import PreparedMission, prepare
from pipeline.mission.run_directory import write_run_directory
from pipeline.mission.run_journal import (
    RunJournal,
    RunRecord,
    begin_journal,
    new_record,
    read_record,
    require_finished,
    resume_journal,
    resumed_plan,
)
from pipeline.mission.stopping import Stop
from pipeline.outputs.summary import Summary
from pipeline.storage.claim import claimed
from pipeline.storage.whole_or_nothing import make_folder


@dataclass(frozen=True)
class RunRequest:
    """The command's options, see its help."""

    mission: Path | None
    out: Path | None
    pace: Pace
    local: bool
    address: str | None
    metrics_port: int | None
    metrics_host: str
    onto: Path | None
    resume: Path | None
    checkpoint_every: float


def run_case(mission: Path, out: Path) -> None:
    """A run on a Ray of its own, as fast as it can, as one of several. Raises RunFailedError if it did not come to its
    end.
    """
    request = RunRequest(
        mission, out, "max", False, None, None, "127.0.0.1", None, None, JournalParams().checkpoint_s
    )
    if run_mission(request):
        raise RunFailedError(f"{mission}: the run ended early")


def run_mission(request: RunRequest) -> int:
    """Run, publish, and say what was found; the exit code: 0, 128 + a signal's number, or that of an error."""
    record = None if request.resume is None else _resumed(request)
    mission = find_mission(request.mission) if record is None else Path(record.mission)
    out = request.resume or request.out or mission.parent / "run"
    stop = Stop()
    with stopped_by_signals(stop), claimed(out), logged_run(out):
        if record is None:
            require_finished(out)
        onto = request.onto if record is None else record.onto
        earlier = None if onto is None else read_earlier_run(Path(onto))
        request = _as_it_flies(request, mission)
        os.environ[FOLDER_VARIABLE] = str(out.absolute() / ACTOR_LOGS)
        with joined(mission, request.address, stop) as near:
            prepared = noticed(prepare(_as_seen_from(near, mission), earlier, near), near)
            begun = _Begun(request, prepared, out, record)
            try:
                finished = _run(request, prepared, begun, record, stop, out)
            except BaseException:
                begun.forget()
                raise
            summary = write_run_directory(as_flown(prepared, finished.flown), finished, out, near)
            begun.published(finished.partial is None)
    return _said(summary, finished, out, stop)


def _as_seen_from(near: Near, mission: Path) -> Path:
    """On other nodes there is no folder that we are in."""
    return mission if near is here else mission.absolute()


def _as_it_flies(request: RunRequest, mission: Path) -> RunRequest:
    """Live streams come in real time. Raises InputError for one process: what is lost there is not replaced."""
    if not load_mission(mission).is_live:
        return request
    if request.local:
        raise InputError("--local", f"live streams in {mission}", "a run on Ray, without --local")
    return replace(request, pace="realtime")


def _resumed(request: RunRequest) -> RunRecord:
    """The run to go on with. Raises InputError where it cannot, or where an option contradicts it."""
    assert request.resume is not None
    record = read_record(request.resume)
    if record.pace == "realtime":
        found = "a run in real time: its moments do not come back"
        raise InputError(request.resume, found, "a run at --pace max, or with --local")
    for name, given, mine in (
        ("--out", request.out, request.resume),
        ("the mission", request.mission, Path(record.mission)),
        ("--onto", request.onto, None if record.onto is None else Path(record.onto)),
    ):
        if given is not None and (mine is None or given.absolute() != mine.absolute()):
            raise InputError(name, str(given), f"{mine}, as the run of --resume has it, or nothing")
    return record


class _Begun:
    """The run's journal, from when there is a plan on."""

    def __init__(
        self, request: RunRequest, prepared: PreparedMission, out: Path, record: RunRecord | None
    ) -> None:
        self._request, self._prepared, self._out, self._record = request, prepared, out, record
        self._params = JournalParams(checkpoint_s=request.checkpoint_every)
        self._journal: RunJournal | None = None
        self._was_there = out.exists()
        self._pace = request.pace if record is None else record.pace
        if record is not None:
            self._journal = resume_journal(out, record, prepared, self._params)

    def __call__(self, plan: Plan) -> RunJournal:
        """The journal for a plan."""
        if self._journal is None:
            pace = "local" if self._request.local else self._request.pace
            forecast = disk_forecast(self._prepared, plan, self._params)
            require_room(forecast, self._out)
            say(forecast.sentence)
            record = new_record(self._prepared, plan, pace)
            self._journal = begin_journal(self._out, record, self._params)
            shutil.rmtree(self._out / ACTOR_LOGS, ignore_errors=True)
        if not (self._request.local or self._pace == "local"):
            make_folder(self._out / ACTOR_LOGS)
        begin_live(self._out, self._prepared)
        return self._journal

    def forget(self) -> None:
        """A new run has failed before anything was taken."""
        if self._record is None and self._journal is not None:
            self._journal.discard()
            end_live(self._out)
            if not self._was_there:
                shutil.rmtree(self._out / ACTOR_LOGS, ignore_errors=True)
                with suppress(OSError):  # logs, or what somebody has put there
                    self._out.rmdir()

    def published(self, whole: bool) -> None:
        """What was found is written."""
        assert self._journal is not None
        end_live(self._out)
        if whole:
            self._journal.discard()
        else:
            self._journal.has_been_published()


def _run(
    request: RunRequest,
    prepared: PreparedMission,
    begin: Callable[[Plan], RunJournal],
    record: RunRecord | None,
    stop: Stop,
    out: Path,
) -> FinishedRun:
    plan = None if record is None else resumed_plan(out, record)
    with progress_bars("frames") as progress:
        if request.local or (record is not None and record.pace == "local"):
            plan = plan or plan_mission(prepared)
            return run_local(prepared, plan, progress, begin(plan), stop)
        pace = request.pace if record is None else "max"  # no other can go on
        options = RunOptions(pace, request.address, request.metrics_port, request.metrics_host)
        return run_on_ray(prepared, options, progress, say, begin, stop, plan)


def _said(summary: Summary, finished: FinishedRun, out: Path, stop: Stop) -> int:
    for finding in summary.findings:
        if finding.severity == "warning":
            say(str(finding))
    print_people(summary)
    say(f"{summary.video_seconds:.1f} s of video in {summary.seconds:.1f} s; see {out / 'report.html'}")
    if finished.partial is None:
        return 0
    again = "" if finished.pace == "realtime" else f"; to go on with it: searchlight run --resume {out}"
    say(f"{finished.partial.sentence} What was found so far is in {out}{again}")
    if finished.error is not None:
        for line in str(finished.error).splitlines():
            say(f"error: {line}")
        return finished.error.exit_code
    return 128 + int(getattr(signal, (stop.reason or "").rpartition(" ")[2], signal.SIGTERM))
