"""Where a run stands is said from its files and its lock, and never better than it is."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from typer.testing import CliRunner

from actors.cli import app
from pipeline.errors import InputError
from pipeline.mission.status import run_status
from pipeline.storage.claim import claimed, writer_of

NOW = datetime(2026, 12, 1, 6, 0, 30, tzinfo=UTC)
REDUCER = {
    "at": "2026-12-01T06:00:29.000Z", "places": 2, "possible": 1, "verdict": {"sentence": "2 places."}
}  # fmt: skip
LINK = {"stream": "v", "site": "ground", "rate_bps": 2.5e6, "sent_bytes": 1_200_000, "down": {}}
STATUS = {
    "at": "2026-12-01T06:00:29.500Z",
    "mission": "valley",
    "pace": "realtime",
    "seconds": 29.5,
    "lost": [],
    "streams": {
        "v": {
            "captured": 90, "in_all": 300, "processed": 20, "in_flight": 2, "finished": False,
            "contradiction": 0, "dropped": {"not_sampled": 60, "link_full": 8},
        }
    },
    "links": [LINK, LINK | {"site": "v", "sent_bytes": 0, "rate_bps": None}],
    "machines": {"pc": {"waiting": 3, "rejected": 1}},
    "timeline": [{"at_s": float(k), "what": "up", "subject": f"actor-{k}", "detail": ""} for k in range(20)],
}  # fmt: skip


def flying(folder: Path, **status: object) -> Path:
    run = folder / "run"
    (run / "live").mkdir(parents=True)
    (run / "live" / "status.json").write_text(json.dumps(STATUS | status))
    (run / "live" / "reducer.json").write_text(json.dumps(REDUCER))
    return run


def test_a_run_that_flies_says_what_was_found_and_every_frame(tmp_path: Path) -> None:
    run = tmp_path / "run"
    with claimed(run):
        flying(tmp_path)
        found = run_status(run, NOW)
        result = CliRunner().invoke(app, ["status", str(run), "--json"])
    assert found.state == "flies"
    text = "\n".join(found.lines)
    assert found.lines[0].startswith("valley flies for 29.5 s, pace realtime (process ")
    assert found.lines[1] == "map of 2026-12-01T06:00:29.000Z: 2 places."
    assert (
        "v: captured 90 of 300, processed 20, in flight 2, dropped 8 (link_full), dropped 60 (not_sampled)"
        in text
    )
    assert "link v to ground: 2.50 Mbps, 1.2 MB sent" in text
    assert "link v to v" not in text
    assert "machine pc: 3 packets wait, 1 rejected" in text
    assert found.lines[-1] == "   19.0 s  up actor-19"
    assert "WARNING" not in text
    assert json.loads(result.stdout) == {"state": "flies", "status": STATUS, "map": REDUCER}


def test_one_that_hangs_who_is_lost_a_link_that_is_down_and_frames_that_do_not_add_up_are_said(
    tmp_path: Path,
) -> None:
    stream = STATUS["streams"]["v"] | {"contradiction": 4}
    down = LINK | {"down": {"a": "silent", "b": "silent"}, "rate_bps": None}
    run = tmp_path / "run"
    with claimed(run):
        flying(tmp_path, lost=["machine:pc"], streams={"v": stream}, links=[down])
        lines = run_status(run, NOW + timedelta(seconds=60)).lines
    assert "WARNING: nothing was heard of it for 60 s" in lines
    assert "WARNING: lost at this moment: machine:pc" in lines
    assert any(line.startswith("v: ") and "CONTRADICTION 4" in line for line in lines)
    assert "link v to ground: unmeasured, 1.2 MB sent, DOWN: silent" in lines


def test_one_that_has_just_begun_says_only_that(tmp_path: Path) -> None:
    with claimed(tmp_path / "run"):
        found = run_status(tmp_path / "run", NOW)
    assert found.state == "begins"


@pytest.mark.parametrize(("pace", "again"), [("realtime", False), ("max", True)])
def test_one_that_was_killed_is_not_said_to_fly(tmp_path: Path, pace: str, again: bool) -> None:
    found = run_status(flying(tmp_path, pace=pace), NOW)
    assert found.state == "cut off"
    assert "no process writes here, last heard of at 2026-12-01T06:00:29.500Z" in found.lines[0]
    assert ("--resume" in found.lines[0]) == again
    assert "places 2, possible places 1" in found.lines


@pytest.mark.parametrize(("partial", "state"), [(None, "ended"), ({"reason": "stopped"}, "ended early")])
def test_one_that_has_ended_says_its_verdict(tmp_path: Path, partial: object, state: str) -> None:
    summary = {
        "mission": "valley",
        "partial": partial,
        "verdict": {"sentence": "Nobody was found."},
        "streams": [{"stream": "v", "captured": 3, "processed": 1, "dropped": {"not_sampled": 2}}],
        "timeline": [],
    }
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    found = run_status(tmp_path, NOW)
    assert found.state == state
    assert found.lines == (
        "valley has ended: Nobody was found.",
        "v: captured 3, processed 1, dropped 2 (not_sampled)",
    )


def test_a_folder_of_no_run_and_a_spoiled_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found no run"):
        run_status(tmp_path, NOW)
    (tmp_path / "summary.json").write_text("{")
    with pytest.raises(InputError, match=r"summary\.json: found what cannot be read"):
        run_status(tmp_path, NOW)


def test_who_asks_takes_no_lock(tmp_path: Path) -> None:
    assert writer_of(tmp_path / "run") is None
    with claimed(tmp_path / "run"):
        assert writer_of(tmp_path / "run") is not None
    with claimed(tmp_path / "run"):
        pass
    assert not list(tmp_path.iterdir())
