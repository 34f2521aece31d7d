"""The controller's log as a file: it gives the orders again, says where it does not, and costs no mission."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.mission.controller.recorded import Recorded
from pipeline.mission.controller_log import ControllerLog, replayed
from pipeline.mission.rehearsal.rehearse import Rehearsal
from tests.rehearsals import rehearsed


def written(rehearsal: Rehearsal, path: Path, log: list[Recorded] | None = None) -> Path:
    file = ControllerLog(path, rehearsal.problem, 0.0, rehearsal.scheduler.state.here)
    for recorded in rehearsal.scheduler.log if log is None else log:
        file.append([recorded])
    file.close()
    return path


@pytest.mark.parametrize("seed", [71, 72, 73])
def test_played_again_it_ends_in_the_same_state(tmp_path: Path, seed: int) -> None:
    rehearsal = rehearsed(seed)
    state, events = replayed(written(rehearsal, tmp_path / "log"))
    assert events == len(rehearsal.scheduler.log) > 100
    assert state == rehearsal.scheduler.state


def test_an_order_that_was_another_one_is_found(tmp_path: Path) -> None:
    rehearsal = rehearsed(71)
    log = list(rehearsal.scheduler.log)
    number = next(i for i, r in enumerate(log) if r.orders)
    log[number] = replace(log[number], orders=log[number].orders[1:])
    with pytest.raises(InputError, match=f"event {number + 1}, "):
        replayed(written(rehearsal, tmp_path / "log", log))


def test_of_a_run_that_was_killed_the_log_is_read_to_its_last_whole_line(tmp_path: Path) -> None:
    rehearsal = rehearsed(72)
    whole = written(rehearsal, tmp_path / "log").read_bytes()
    (tmp_path / "cut").write_bytes(whole[: len(whole) * 2 // 3])
    _, events = replayed(tmp_path / "cut")
    assert 10 < events < len(rehearsal.scheduler.log)


@pytest.mark.parametrize(
    "line", [b"[]", b"{}", b'{"event": 3, "at_s": 1.0, "orders": []}', b'{"event": {"@": "map"}}']
)
def test_a_line_that_is_no_event_is_named(tmp_path: Path, line: bytes) -> None:
    whole = gzip.decompress(written(rehearsed(72), tmp_path / "log").read_bytes()).splitlines()
    (tmp_path / "log").write_bytes(gzip.compress(b"\n".join([*whole[:5], line, b""])))
    with pytest.raises(InputError, match="line 6, which is no part of such a log"):
        replayed(tmp_path / "log")


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no gzip",
        *(
            gzip.compress(line + b"\n", mtime=0)
            for line in (
                b"no json",
                b'{"format": "another"}',
                b"[1]",
                b'{"format": "searchlight controller log 1"}',
                b'{"format": "searchlight controller log 1", "begun_s": 1.0, "problem": {"@": "Nobody"}}',
                b'{"format": "searchlight controller log 1", "begun_s": 1.0, "problem": 3}',
            )
        ),
    ],
)
def test_another_file_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "log").write_bytes(content)
    with pytest.raises(InputError, match="log"):
        replayed(tmp_path / "log")


def test_where_it_cannot_be_written_the_mission_goes_on(tmp_path: Path) -> None:
    rehearsal = rehearsed(71)
    file = ControllerLog(tmp_path / "nowhere" / "log", rehearsal.problem, 0.0, ())
    file.append(rehearsal.scheduler.log)
    file.close()
