"""The verdict: found, nobody found, or not to be believed, and then because of what."""

import pytest

from pipeline.ingest.finding import Finding
from pipeline.outputs.verdict import judge

SIZE = "not the size of its class, or no trust"


def test_most_evidence_refused_for_one_reason_is_no_nobody_found() -> None:
    verdict = judge((), None, {SIZE: 979, "no voxel": 3}, 1307)
    assert verdict.kind == "cannot_be_trusted"
    assert "979 of 1,307 boxes were refused: not the size of its class" in verdict.sentence
    assert "heights, focal length" in verdict.sentence


@pytest.mark.parametrize(
    ("not_taken", "boxes"),
    [({}, 0), ({SIZE: 300}, 1307), ({SIZE: 12}, 14), ({"cut by the picture's border": 900}, 1000)],
)
def test_some_refused_evidence_is_no_reason_to_doubt(not_taken: dict[str, int], boxes: int) -> None:
    verdict = judge((), None, not_taken, boxes)
    assert verdict.kind == "nobody_found"
    assert verdict.reasons == not_taken


@pytest.mark.parametrize("cause", ["heading_off", "height_off/focal_length", "exchanged", "clock_off"])
def test_a_warning_that_places_are_wrong_comes_before_what_was_found(cause: str) -> None:
    finding = Finding("warning", cause, "/missions/a/drone-1.srt", "every yaw is off")
    verdict = judge((), None, {}, 100, (finding,))
    assert verdict.kind == "cannot_be_trusted"
    assert "drone-1.srt: every yaw is off" in verdict.sentence


def test_other_warnings_and_assumptions_leave_it() -> None:
    findings = (Finding("warning", "left_out", "a", "b"), Finding("assumed", "height_off", "a", "b"))
    assert judge((), None, {}, 100, findings).kind == "nobody_found"
