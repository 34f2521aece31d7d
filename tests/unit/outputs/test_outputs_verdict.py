"""The verdict: found, nobody found, or not to be believed, and then because of what."""

import pytest
from synthetic_search import location

from pipeline.ingest.finding import Finding
from pipeline.outputs.verdict import judge
from pipeline.second_look.coverage import Coverage

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


def test_a_map_that_no_picture_shows_is_not_nobody_found() -> None:
    verdict = judge((), None, {}, 0, coverage=Coverage("area", 100.0, 100.0, 0.0, 0.0))
    assert verdict.kind == "nobody_looked"
    assert "Nobody looked" in verdict.sentence


@pytest.mark.parametrize("found", [True, False])
@pytest.mark.parametrize(
    ("coverage", "said"),
    [
        (Coverage("area", 3600.0, 3600.0, 2400.0, 5000.0), "Nobody looked at 1,200 of 3,600 square metres"),
        (Coverage("area", 16_000.0, 3880.0, 3880.0, 5000.0), "Not judged: 12,120 of 16,000 square metres"),
        (Coverage("none", 0.0, 0.0, 0.0, 5000.0), "Not judged: the mission states no search area"),
    ],
)
def test_what_nobody_looked_at_stands_beside_what_was_found(
    coverage: Coverage, said: str, found: bool
) -> None:
    verdict = judge([location(1, 0.0, 0.0)] if found else [], None, {}, 0, coverage=coverage)
    assert verdict.kind == ("found" if found else "nobody_found")
    assert said in verdict.sentence


def test_possible_places_are_told_and_a_complete_search_says_no_more() -> None:
    complete = Coverage("ways", 100.0, 100.0, 100.0, 300.0)
    sentence = judge([], None, {}, 0, possible=[location(1, 0.0, 0.0, 0.4)], coverage=complete).sentence
    assert sentence == "No place reached the threshold. 1 possible place below the threshold is listed."
