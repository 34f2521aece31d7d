"""An operator is told of each change of a live stream once."""

from __future__ import annotations

from actors.stream_health import StreamHealths
from pipeline.ingest.live.health import Health


def _told(*healths: Health) -> list[str]:
    known = StreamHealths()
    return [said.what for health in healths for said in known.told("one", health)]


def test_a_silence_is_told_once_and_its_end_too() -> None:
    flows, silent = Health("flows", 0.1, 1), Health("silent", 2.0, 1, "nothing came any more")
    again = Health("flows", 0.1, 2)
    assert _told(Health("waiting"), flows, flows, silent, silent, silent, again, again) == [
        "flows",
        "silent",
        "flows again",
    ]


def test_a_connection_that_broke_and_came_back_between_two_questions_is_told() -> None:
    assert _told(Health("flows", 0.0, 1), Health("flows", 0.0, 3)) == ["flows", "flows again"]


def test_what_capture_times_rest_on_is_told_when_it_changes() -> None:
    by = [Health("flows", basis="arrival"), Health("flows", basis="ntp"), Health("flows", basis="ntp")]
    assert _told(*by) == ["flows", "capture times"]


def test_poses_that_stop_and_come_again_are_told() -> None:
    flows = Health("flows")
    lost = Health("flows", pose_fault="no fix")
    assert _told(flows, lost, lost, flows) == ["flows", "no poses", "poses again"]


def test_the_end_is_told_with_its_reason() -> None:
    known = StreamHealths()
    known.told("one", Health("flows"))
    (said,) = known.told("one", Health("over", 30.0, 1, "the sender ended it"))
    assert (said.what, said.subject) == ("over", "one")
    assert "did not come back: the sender ended it" in said.detail
