"""The ledger: each end counts for itself, as frames come, and where the two do not agree it is said."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import InputError
from pipeline.mission.disk_forecast import ForecastParams, disk_forecast, require_room
from pipeline.mission.durable_reducer import JournalParams
from pipeline.mission.ledger import contradictions, stream_account, substream_counts, with_heard
from pipeline.mission.local import FinishedRun, run_local
from pipeline.mission.planning import plan
from pipeline.mission.prepared import PreparedMission, prepare
from pipeline.mission.run_journal import begin_journal, new_record
from pipeline.mission.stages.frame_tally import FrameTally
from pipeline.mission.stages.source import SourceCount


@given(st.lists(st.tuples(st.sampled_from(["look", "busy", "undecodable"]), st.integers(0, 6))))
def test_what_is_counted_as_it_comes_is_what_counting_at_the_end_gives(events: list[tuple[str, int]]) -> None:
    tally = FrameTally()
    for what, index in events:
        if what == "look":
            tally.look(index)
        else:
            tally.drop(index, what)
    looked = {i for what, i in events if what == "look"}
    last = {i: what for what, i in events if what != "look" and i not in looked}
    assert tally.looked == looked
    assert tally.nobody == last
    assert +tally.reasons == Counter(last.values())


@pytest.fixture(scope="module")
def prepared(small_mission: Path) -> PreparedMission:
    return prepare(small_mission)


@pytest.fixture(scope="module")
def run(prepared: PreparedMission) -> FinishedRun:
    return run_local(prepared, plan(prepared), lambda *_: None)


def other(count: SourceCount, **changes: object) -> SourceCount:
    return SourceCount(**{**vars(count), **changes})  # type: ignore[arg-type]


def test_of_a_run_in_which_both_ends_agree_nothing_is_said(run: FinishedRun) -> None:
    for stream, count in run.counts.items():
        assert contradictions(stream, count, run.reducer) == []
        account = stream_account(stream, count, run.reducer)
        assert account.captured == count.captured
        assert not any(reason.startswith("lost") for reason in account.dropped)


def test_a_frame_whose_result_never_came_is_lost_by_name(run: FinishedRun) -> None:
    for stream, count in run.counts.items():
        detector = next(d for due in count.due.values() for d in due)
        due = {**count.due, 9001: (detector,), 9002: (detector,)}
        account = stream_account(stream, other(count, due=due, captured=count.captured + 2), run.reducer)
        assert account.dropped["lost_last_seen_at_source"] == 2


def test_what_the_ends_do_not_agree_on_is_said_and_the_account_still_closes(run: FinishedRun) -> None:
    for stream, count in run.counts.items():
        (first, *_), detector = sorted(run.reducer.frames(stream)), next(iter(count.due.values()))[0]
        less = {index: due for index, due in count.due.items() if index != first}
        (finding, *_) = contradictions(stream, other(count, due=less), run.reducer)
        assert (finding.severity, finding.cause) == ("warning", "ledger_contradiction")
        assert f"never to be sent, the first is number {first}" in finding.found
        stream_account(stream, other(count, due=less), run.reducer)
        received = {d: f for (s, d), f in run.reducer.received.items() if s == stream}
        detector, index = next((d, min(f)) for d, f in received.items() if f)
        for reason, said in (("link_full", True), ("link_lost", False)):
            wrong = other(count, dropped={**count.dropped, (index, detector): reason})
            findings = contradictions(stream, wrong, run.reducer)
            assert bool(findings) == said
            if said:
                assert "the source did not send" in findings[0].found


def test_the_forecast_is_no_less_than_what_a_run_keeps(prepared: PreparedMission, tmp_path: Path) -> None:
    chosen, params = plan(prepared), JournalParams(checkpoint_s=1e9)
    forecast = disk_forecast(prepared, chosen, params)
    journal = begin_journal(tmp_path / "run", new_record(prepared, chosen, "local"), params)
    run = run_local(prepared, chosen, lambda *_: None, journal)
    kept = sum(path.stat().st_size for path in journal.folder.glob("*.log"))
    assert 0.2 * forecast.journal_bytes < kept <= forecast.journal_bytes
    journal.reducer(run.reducer, 0.0).checkpoint()
    (checkpoint,) = journal.folder.glob("*.state")
    assert checkpoint.stat().st_size * 3 <= forecast.checkpoint_bytes
    more = disk_forecast(prepared, chosen, JournalParams(checkpoints=5))
    assert more.checkpoint_bytes == pytest.approx(2.0 * forecast.checkpoint_bytes)
    longer = disk_forecast(prepared, chosen, params, ForecastParams(boxes=80))
    assert longer.journal_bytes > 2 * forecast.journal_bytes
    assert np.isclose(forecast.bytes, forecast.journal_bytes + forecast.checkpoint_bytes)


def test_a_disk_that_has_less_is_refused_before_anything_is_written(
    prepared: PreparedMission, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    forecast = disk_forecast(prepared, plan(prepared), JournalParams())
    for short, refused in ((0, False), (1, True)):
        free = forecast.bytes + forecast.left_bytes - short

        class Usage:
            def __init__(self, free: int) -> None:
                self.free = free

        monkeypatch.setattr("shutil.disk_usage", lambda path, free=free: Usage(free))
        if not refused:
            require_room(forecast, tmp_path / "new" / "run")
            continue
        with pytest.raises(InputError, match="free on its disk; expected"):
            require_room(forecast, tmp_path / "new" / "run")
    assert list(tmp_path.iterdir()) == []


def test_a_source_that_was_started_again_is_told_what_the_reducer_heard_of_the_one_before(
    run: FinishedRun,
) -> None:
    for stream, count in run.counts.items():
        first = sorted(count.due)[: len(count.due) // 2]
        # the next process has passed over these: to it nobody was to see some, and it was late for others
        due = {i: () if i in first[::2] else detectors for i, detectors in count.due.items()}
        late = {(i, d): "source_late" for i in first[1::2] for d in count.due[i]}
        again = other(count, due=due, dropped={**count.dropped, **late})
        assert contradictions(stream, again, run.reducer)
        whole = with_heard(stream, again, run.reducer)
        assert contradictions(stream, whole, run.reducer) == []
        assert stream_account(stream, whole, run.reducer) == stream_account(stream, count, run.reducer)
        mine = [a for a in run.plan.assignments if a.stream == stream]
        expected = substream_counts(mine, run.counts, run.reducer)
        assert substream_counts(mine, {stream: whole}, run.reducer) == expected
