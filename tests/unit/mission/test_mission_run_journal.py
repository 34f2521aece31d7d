"""A run that is stopped, fails or dies leaves what it needs to go on, and says what is missing."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.allocation.plan import Plan
from pipeline.errors import InputError, RunFailedError
from pipeline.fusion.map_file import map_records
from pipeline.mission.durable_reducer import JournalParams
from pipeline.mission.local import FinishedRun, run_local
from pipeline.mission.planning import plan
from pipeline.mission.prepared import PreparedMission, prepare
from pipeline.mission.run_journal import (
    begin_journal,
    new_record,
    read_record,
    require_finished,
    resume_journal,
    resumed_plan,
)
from pipeline.mission.stages.detector import DetectorStage
from pipeline.mission.stopping import Stop
from pipeline.storage.disk import LocalDisk
from pipeline.storage.whole_or_nothing import UNFINISHED

PARAMS = JournalParams(commit_s=0.02, checkpoint_s=0.25)


class KilledError(BaseException):
    """No handler of ours may catch it."""


@pytest.fixture(scope="module")
def mission(small_mission: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("of_ours") / "mission"
    shutil.copytree(small_mission.parent, folder)
    return folder / "mission.yaml"


@pytest.fixture(scope="module")
def prepared(mission: Path) -> PreparedMission:
    return prepare(mission)


@pytest.fixture(scope="module")
def chosen(prepared: PreparedMission) -> Plan:
    return plan(prepared)


@pytest.fixture(scope="module")
def whole(prepared: PreparedMission, chosen: Plan) -> FinishedRun:
    return run_local(prepared, chosen, lambda *_: None)


def maps(run: FinishedRun) -> list[bytes]:
    return [record for voxel_map in run.reducer.fuser.maps.values() for record in map_records(voxel_map)]


def at_call(number: int, act: Callable[[], None]) -> Callable[[str, int, int], None]:
    """A progress that does something at its n-th call."""
    calls = [0]

    def progress(*_: object) -> None:
        calls[0] += 1
        if calls[0] == number:
            act()

    return progress


def kill() -> None:
    raise KilledError


def killed(prepared: PreparedMission, chosen: Plan, out: Path, at: int) -> None:
    journal = begin_journal(out, new_record(prepared, chosen, "local"), PARAMS)
    with pytest.raises(KilledError):
        run_local(prepared, chosen, at_call(at, kill), journal)


def resumed(
    prepared: PreparedMission, out: Path, progress: Callable[..., None] = lambda *_: None
) -> FinishedRun:
    record = read_record(out)
    return run_local(
        prepared, resumed_plan(out, record), progress, resume_journal(out, record, prepared, PARAMS)
    )


@pytest.mark.parametrize("seed", [0, 1, 2, *(pytest.param(s, marks=pytest.mark.slow) for s in range(3, 20))])
def test_killed_at_random_moments_it_goes_on_to_the_same_map(
    prepared: PreparedMission, chosen: Plan, whole: FinishedRun, tmp_path: Path, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    frames = sum(count.captured for count in whole.counts.values()) // 3
    killed(prepared, chosen, tmp_path / "run", int(rng.integers(1, frames)))
    for _ in range(int(rng.integers(0, 3))):
        with pytest.raises(KilledError):
            resumed(prepared, tmp_path / "run", at_call(int(rng.integers(1, frames)), kill))
    run = resumed(prepared, tmp_path / "run")
    assert maps(run) == maps(whole)
    assert run.counts == whole.counts
    assert run.reducer.processed == whole.reducer.processed
    assert run.reducer.not_taken == whole.reducer.not_taken
    assert run.partial is None


def test_what_is_known_is_not_looked_at_again(
    prepared: PreparedMission, chosen: Plan, whole: FinishedRun, tmp_path: Path
) -> None:
    killed(prepared, chosen, tmp_path / "run", 90)
    journal = resume_journal(tmp_path / "run", read_record(tmp_path / "run"), prepared, PARAMS)
    looked: list[str] = []
    process = DetectorStage.process
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(DetectorStage, "process", lambda *a: looked.append("") or process(*a))
        run_local(prepared, chosen, lambda *_: None, journal)
    in_all = sum(len(frames) for frames in whole.reducer.received.values())
    assert 0 < len(looked) < 0.9 * in_all


def test_stopped_it_says_where_each_stream_was_cut_off(
    prepared: PreparedMission, chosen: Plan, whole: FinishedRun, tmp_path: Path
) -> None:
    stop = Stop(utc_ns=lambda: 1_800_000_000_000_000_000)
    out = tmp_path / "run"
    journal = begin_journal(out, new_record(prepared, chosen, "local"), PARAMS)
    run = run_local(prepared, chosen, at_call(31, lambda: stop.ask("stopped by SIGTERM")), journal, stop)
    assert run.partial is not None
    assert run.partial.reason == "stopped by SIGTERM"
    assert {cut.stream for cut in run.partial.cut_off} == {s.stream for s in prepared.streams}
    for cut in run.partial.cut_off:
        # 10 pictures a second, of two streams in turn: 16 each
        assert cut.reached_s == pytest.approx(1.5, abs=0.11)
        assert cut.length_s == pytest.approx(5.0, abs=0.05)
    assert "PARTIAL MAP: stopped by SIGTERM at 2027-01-15T08:00:00Z; drone-1 was cut off at 1." in (
        run.partial.sentence
    )
    assert maps(run) != maps(whole)
    assert maps(resumed(prepared, out)) == maps(whole)


def test_a_part_that_fails_costs_what_it_was_to_do_and_no_more(
    prepared: PreparedMission, chosen: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail() -> None:
        raise OSError(errno.EIO, "the card is gone")

    journal = begin_journal(tmp_path / "run", new_record(prepared, chosen, "local"), PARAMS)
    run = run_local(prepared, chosen, at_call(31, fail), journal)
    assert isinstance(run.error, RunFailedError)
    assert run.error.exit_code == 1
    assert run.partial is not None
    assert run.partial.reason == "failed: OSError: [Errno 5] the card is gone"
    assert any(run.reducer.processed.values())
    with monkeypatch.context() as patch:
        patch.setattr(DetectorStage, "process", lambda *_: fail())
        with pytest.raises(RunFailedError, match="the card is gone"):  # nothing was seen: there is no map
            run_local(prepared, chosen, lambda *_: None)


def test_a_full_disk_does_not_stop_the_search_and_is_said(
    prepared: PreparedMission,
    chosen: Plan,
    whole: FinishedRun,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    journal = begin_journal(tmp_path / "run", new_record(prepared, chosen, "local"), PARAMS)
    writes, create = [0], LocalDisk.create

    def full(self: LocalDisk, path: Path) -> object:
        file = create(self, path)
        write = file.write

        def limited(data: bytes) -> None:
            writes[0] += 1
            if writes[0] > 12:
                raise OSError(errno.ENOSPC, "No space left on device")
            write(data)

        file.write = limited  # type: ignore[method-assign]
        return file

    with monkeypatch.context() as patch:
        patch.setattr(LocalDisk, "create", full)
        run = run_local(prepared, chosen, lambda *_: None, journal)
    assert maps(run) == maps(whole)
    (finding,) = run.findings
    assert (finding.severity, finding.cause) == ("warning", "journal_stopped")
    assert "No space left on device" in finding.found
    assert maps(resumed(prepared, tmp_path / "run")) == maps(whole)


def test_another_input_file_another_code_or_no_run_is_refused_in_one_line(
    mission: Path, prepared: PreparedMission, chosen: Plan, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    killed(prepared, chosen, out, 10)
    record = read_record(out)
    for name in ("drone-2.mp4", "drone-1.srt", "pool.yaml", "terrain.tif"):
        path = mission.parent / name
        data = path.read_bytes()
        path.write_bytes(data[:-9] + bytes([data[-9] ^ 1]) + data[-8:])
        with pytest.raises(InputError, match=rf"{name}: found other content"):
            resume_journal(out, record, prepared, PARAMS)
        path.write_bytes(data)
    with pytest.raises(InputError, match=r"Searchlight 0\.0\.1 began"):
        resume_journal(out, replace(record, version="0.0.1"), prepared, PARAMS)
    with pytest.raises(InputError, match="with other code"):
        resume_journal(out, replace(record, code="ab" * 32), prepared, PARAMS)
    other = begin_journal(tmp_path / "other", replace(record, mission="another.yaml"), PARAMS)
    for file in other.folder.parent.glob("journal/run.json"):
        (out / UNFINISHED).write_bytes(file.read_bytes())
    journal = resume_journal(out, read_record(out), prepared, PARAMS)
    with pytest.raises(InputError, match="another mission"):
        run_local(prepared, chosen, lambda *_: None, journal)
    with pytest.raises(InputError, match="no run that was cut off"):
        read_record(tmp_path)
    (out / UNFINISHED).write_text('{"format": "searchlight run in progress 9"}')
    with pytest.raises(InputError, match="in progress 9"):
        read_record(out)


def test_a_new_run_does_not_take_the_place_of_one_whose_map_was_never_written(
    prepared: PreparedMission, chosen: Plan, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    require_finished(out)
    journal = begin_journal(out, new_record(prepared, chosen, "local"), PARAMS)
    with pytest.raises(InputError, match="--resume"):
        require_finished(out)
    journal.has_been_published()
    require_finished(out)
    resume_journal(out, read_record(out), prepared, PARAMS)
    with pytest.raises(InputError, match="--resume"):
        require_finished(out)
    journal.discard()
    require_finished(out)
