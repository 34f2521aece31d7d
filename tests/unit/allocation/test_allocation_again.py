"""Planning again in flight: who is served, who is not and why, what happens when something goes wrong."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from pipeline.allocation import again, decomposed, fewest_changes
from pipeline.allocation.again import first_valid, plan_again
from pipeline.allocation.plan import Assignment
from pipeline.allocation.planned_again import PlannedAgain, ranks_of
from pipeline.allocation.problem import Deadline, Detector, MachineLimit, Problem
from pipeline.allocation.validate import validate
from pipeline.errors import InvalidPlanError, NoPlanError

GB = 1e9


def problem(streams: int, machines: int, *, period: int = 1, gb: float = 2.0, **changes: Any) -> Problem:
    """Equal machines of 4 GB at one site, one network that takes 2 GB; links of 8 Mbps, levels of 1 and 4."""
    names = tuple(f"v{i}" for i in range(streams))
    fields: dict[str, Any] = {
        "streams": names,
        "sites": ("s",),
        "machines": tuple(MachineLimit(f"m{i}", "s", 4 * GB) for i in range(machines)),
        "detectors": tuple(
            Detector(f"m{i}:d", "d", f"m{i}", "s", period, gb * GB, (0.4, 0.8), period / 10)
            for i in range(machines)
        ),
        "bitrates_bps": (1e6, 4e6),
        "link_bps": {(v, "s"): 8e6 for v in names},
        "frame_rate_hz": 10.0,
        "detectors_per_stream": 2,
        "detectors_per_frame": 2,
        "accuracy_weight": 1.0,
    }
    return Problem(**{**fields, **changes})


def served(found: PlannedAgain) -> set[str]:
    assert validate(found.problem, found.plan) == []
    return set(found.problem.streams)


def both(of: Problem, running: tuple[Assignment, ...], priorities: Mapping[str, int]) -> list[PlannedAgain]:
    return [
        first_valid(of, running, priorities=priorities, time_limit_s=10.0),
        plan_again(of, running, priorities=priorities, time_limit_s=10.0),
    ]


def test_the_streams_of_the_greatest_priority_are_served_when_not_all_can_be() -> None:
    """One machine with room for two detectors, five streams."""
    for found in both(problem(5, 1), (), {"v1": 3, "v4": 3}):
        assert served(found) == {"v1", "v4"}
        assert [one.stream for one in found.unserved] == ["v0", "v2", "v3"]


def test_a_stream_that_joins_with_a_greater_priority_makes_the_others_give_way() -> None:
    of = problem(3, 1)
    running = first_valid(replace(of, streams=("v0", "v1")), (), time_limit_s=10.0).plan.assignments
    assert {a.stream for a in running} == {"v0", "v1"}
    for found in both(of, running, {"v2": 1}):
        assert "v2" in served(found)
        assert len(served(found)) == 2
    for found in both(of, running, {"v2": -1}):
        assert served(found) == {"v0", "v1"}
        assert [one.stream for one in found.unserved] == ["v2"]


def test_one_stream_is_never_given_up_for_two_of_a_lower_priority() -> None:
    """Every stream takes two detectors, one on each of two machines: there is room for two streams, or one."""
    of = problem(3, 2, period=2, detectors_per_frame=1)
    for found in both(of, (), {"v0": 1}):
        assert "v0" in served(found)
        assert len(served(found)) == 2
    one_each = replace(of, machines=tuple(replace(m, memory_bytes=2 * GB) for m in of.machines))
    for found in both(one_each, (), {"v2": 7}):
        assert served(found) == {"v2"}


def test_priorities_become_ranks_without_gaps() -> None:
    assert ranks_of(("a", "b", "c", "d"), {"a": -5, "c": 10, "d": 10}) == {"a": 2, "b": 1, "c": 0, "d": 0}


@pytest.mark.parametrize(
    ("of", "words"),
    [
        (replace(problem(1, 1), link_bps={}), "it has no link to a site with a detector"),
        (replace(problem(1, 1), link_bps={("v0", "s"): 5e5}), "its links carry too little (0.5 Mbps to s; "),
        (replace(problem(1, 1), detectors=()), "there is no detector left"),
        (problem(1, 1, gb=5.0), "have not the memory, even if they are empty"),
        (problem(1, 3, period=3), "2 detectors (detectors_per_stream) do not see every frame"),
        (problem(1, 1, period=2), "no 2 of the detectors together see every frame at 10 Hz"),
        (
            replace(problem(1, 1), deadline=Deadline(0.11, encode_s=0.02)),
            "answer within 0.11 s over its links (8 Mbps to s)",
        ),
        (
            replace(problem(1, 1, gb=5.0), link_bps={("v0", "s"): 5e5}),
            "its links (0.5 Mbps to s) and the machines' memory exclude each other",
        ),
    ],
)
def test_who_cannot_be_served_at_all_is_told_the_limit(of: Problem, words: str) -> None:
    for found in both(of, (), {}):
        assert not served(found)
        (one,) = found.unserved
        assert words in one.reason


def test_too_many_looks_at_a_frame_are_named() -> None:
    """Periods of 2, 3, 3 and 6 cover together only if a frame may be looked at more than once."""
    of = problem(1, 4, detectors_per_frame=1, detectors_per_stream=4)
    odd = tuple(replace(d, period=period) for d, period in zip(of.detectors, (2, 3, 3, 6), strict=True))
    (one,) = plan_again(replace(of, detectors=odd), (), time_limit_s=10.0).unserved
    assert one.reason == "its detectors do not see every frame with at most 1 on one (detectors_per_frame)"


def test_who_finds_the_machines_full_is_told_what_is_left() -> None:
    found = plan_again(problem(3, 1, gb=1.5), (), time_limit_s=10.0)
    (one,) = found.unserved
    assert one.reason == (
        "the machines are full with the 2 streams served: the most that is free on one that it reaches is "
        "1 GB on m0"
    )
    one_only = problem(3, 2, memory_rule="one_detector_per_machine")
    (one,) = plan_again(one_only, (), time_limit_s=10.0).unserved
    assert one.reason.endswith("0 of 2 machines that it reaches run no detector yet")
    assert (
        "no place was found for it in time" in first_valid(one_only, (), time_limit_s=10.0).unserved[0].reason
    )


def test_the_text_says_who_is_not_served_and_why() -> None:
    of = problem(2, 2, link_bps={("v0", "s"): 8e6})
    found = plan_again(of, (), time_limit_s=10.0)
    assert found.text.splitlines() == [
        f"1 of 2 streams served (proven); 0 substreams go on, 0 end, {len(found.begun)} begin",
        "stream v1 is not served: it has no link to a site with a detector",
    ]


def test_a_hopeless_stream_leaves_the_others_alone() -> None:
    of = problem(4, 4)
    running = decomposed.solve(of, time_limit_s=10.0).assignments
    cut = replace(of, link_bps={**of.link_bps, ("v2", "s"): 0.0})
    for found in both(cut, running, {"v2": 9}):
        assert served(found) == {"v0", "v1", "v3"}
        assert {a.stream for a in found.ended} == {"v2"}
        assert found.kept == tuple(a for a in running if a.stream != "v2")


def test_nothing_is_left_to_serve_or_to_serve_with() -> None:
    running = decomposed.solve(problem(2, 2), time_limit_s=10.0).assignments
    empty = problem(0, 2)
    for found in both(empty, running, {}):
        assert served(found) == set()
        assert found.ended == running
    for found in both(replace(problem(2, 2), machines=(), detectors=()), running, {}):
        assert len(found.unserved) == 2
        assert found.ended == running


def test_without_time_what_can_go_on_goes_on() -> None:
    of = problem(4, 4)
    running = decomposed.solve(of, time_limit_s=10.0).assignments
    lost = replace(of, link_bps={**of.link_bps, ("v0", "s"): 0.0})
    for found in (first_valid(lost, running, time_limit_s=0.0), plan_again(lost, running, time_limit_s=0.0)):
        assert served(found) == {"v1", "v2", "v3"}
        assert found.kept == tuple(a for a in running if a.stream != "v0")


def test_an_invalid_best_plan_is_not_handed_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """The mended one takes its place; if that is invalid too, the fault is named."""
    of = problem(2, 2)
    running = decomposed.solve(of, time_limit_s=10.0).assignments
    honest = fewest_changes.place

    def spoilt(*args: Any, **kwargs: Any) -> Any:
        return tuple(replace(a, phase=7) for a in honest(*args, **kwargs))

    monkeypatch.setattr(fewest_changes, "place", spoilt)
    monkeypatch.setattr(again, "_is_better", lambda *args: False)
    found = plan_again(of, running, time_limit_s=10.0)
    assert served(found) == {"v0", "v1"}
    assert not found.proven
    monkeypatch.setattr(again, "repaired", lambda *args: tuple(replace(a, phase=9) for a in running))
    with pytest.raises(InvalidPlanError, match="phase 9 outside"):
        plan_again(of, running, time_limit_s=10.0)
    with pytest.raises(InvalidPlanError, match="phase 9 outside"):
        first_valid(of, running)


@pytest.mark.parametrize("error", [NoPlanError("too many"), ValueError("GLOP ended with status 4")])
def test_where_the_search_cannot_go_on_what_runs_does(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    of = problem(2, 2)
    running = decomposed.solve(of, time_limit_s=10.0).assignments

    def refuse(*args: Any, **kwargs: Any) -> Any:
        raise error

    monkeypatch.setattr(again, "moved", refuse)
    found = plan_again(of, running, time_limit_s=10.0)
    assert served(found) == {"v0", "v1"}
    assert not found.proven
    if isinstance(error, NoPlanError):
        monkeypatch.setattr(again, "repaired", refuse)
        assert served(plan_again(of, running, time_limit_s=10.0)) == set()


def test_the_same_arguments_give_the_same_plan() -> None:
    of = problem(5, 3)
    running = decomposed.solve(of, time_limit_s=10.0).assignments
    lost = replace(of, machines=of.machines[1:], detectors=of.detectors[1:])
    plans = [plan_again(lost, running, time_limit_s=20.0).plan.assignments for _ in range(2)]
    assert plans[0] == plans[1]
    assert math.isfinite(plan_again(lost, running, time_limit_s=20.0).gap)


def test_substreams_that_fit_a_narrower_link_alone_but_not_together_do_not_both_go_on() -> None:
    """Two of period 2 at 4 Mbps send 2 Mbps each; 3 Mbps carry one of them as it is."""
    of = problem(1, 2, period=2)
    running = decomposed.solve(of, time_limit_s=10.0).assignments
    assert [a.bitrate_bps for a in running] == [4e6, 4e6]
    for found in both(replace(of, link_bps={("v0", "s"): 3e6}), running, {}):
        assert served(found) == {"v0"}
        assert len(found.kept) == 1


def test_what_is_given_up_to_move_less_is_no_more_than_the_loss() -> None:
    """A better detector comes: with a loss of 0 it is begun, with one of half the accuracy nothing moves."""
    of = problem(1, 2)
    worse = replace(of.detectors[0], id="m0:old", detector="old", accuracy=(0.2, 0.6))
    other = replace(of.detectors[1], id="m1:old", detector="old", accuracy=(0.2, 0.6))
    before = replace(of, detectors=(worse, other))
    after = replace(of, detectors=(worse, other, *of.detectors), link_bps={("v0", "s"): 4e6})
    running = decomposed.solve(replace(before, link_bps={("v0", "s"): 4e6}), time_limit_s=10.0).assignments
    assert [(a.pool_detector, a.bitrate_bps) for a in running] == [("old", 4e6)]
    best = plan_again(after, running, loss=0.0, time_limit_s=10.0)
    assert [a.pool_detector for a in best.plan.assignments] == ["d"]
    for loss, moves in ((0.2, True), (0.3, False)):  # 0.6 of 0.8: a quarter is lost
        found = plan_again(after, running, loss=loss, time_limit_s=10.0)
        assert bool(found.ended) == moves
        assert found.proven


def test_a_link_that_is_wider_than_whole_numbers_reach_is_no_limit() -> None:
    for found in both(problem(1, 2, link_bps={("v0", "s"): 1e19}), (), {}):
        assert {a.bitrate_bps for a in found.plan.assignments} == {4e6}
