"""Why there is no plan: the limits named are those that clash, and no others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from pipeline.allocation import explain as explanation
from pipeline.allocation.problem import Detector, MachineLimit, Problem

Tiny = Callable[..., Problem]


def explain(problem: Problem) -> str:
    return explanation.explain(problem).text


def test_a_link_that_is_too_narrow_is_named_alone(tiny: Tiny) -> None:
    line = explain(tiny(("fast", 1, 0.8, 2.0), link_mbps=0.5))
    assert "the links of stream v (0.5 Mbps to s)" in line
    assert line.endswith("enough by itself: a link of 1 Mbps from stream v to s")
    assert "memory" not in line
    assert "detectors_per" not in line


def test_a_memory_that_is_too_small_is_named_alone(tiny: Tiny) -> None:
    line = explain(tiny(("fast", 1, 0.8, 2.0), machine_gb=1.0))
    assert line == (
        "these limits cannot hold together: the memory of machine m (1 GB)"
        "; enough by itself: 2 GB on machine m"
    )


def test_one_detector_per_machine_is_named_by_its_rule(tiny: Tiny) -> None:
    pair = (("a", 2, 0.8, 1.0), ("b", 2, 0.7, 1.0))
    assert "one detector at a time on machine m" in explain(
        tiny(*pair, memory_rule="one_detector_per_machine")
    )


def test_detectors_per_frame_is_named_when_periods_collide(tiny: Tiny) -> None:
    mixed = (("a", 2, 0.8, 1.0), ("b", 3, 0.8, 1.0), ("c", 3, 0.8, 1.0), ("d", 3, 0.8, 1.0))
    few = tiny(*mixed[:1], *mixed[1:3], detectors_per_frame=1, detectors_per_stream=3, link_mbps=99.0)
    assert "cannot look at every frame" in explain(few)
    line = explain(tiny(*mixed, detectors_per_stream=2, link_mbps=99.0))
    assert line == (
        "these limits cannot hold together: detectors_per_stream 2; enough by itself: detectors_per_stream 3"
    )


def test_a_clash_of_two_limits_names_both(tiny: Tiny) -> None:
    """Site s is reached but its machine is too small; site t has the memory but no link."""
    two_sites = {
        "sites": ("s", "t"),
        "machines": (MachineLimit("m", "s", 1e9), MachineLimit("n", "t", 9e9)),
        "detectors": tuple(
            Detector(f"{m}:a", "a", m, s, 1, 2e9, (0.5, 0.9), 0.1) for m, s in (("m", "s"), ("n", "t"))
        ),
        "link_bps": {("v", "s"): 9e6},
    }
    line = explain(tiny(**two_sites))
    assert line == (
        "these limits cannot hold together: the links of stream v (9 Mbps to s, none to t); "
        "the memory of machine m (1 GB)"
        "; enough by itself: a link of 1 Mbps from stream v to t, or 2 GB on machine m"
    )


def test_too_few_detectors_are_told_apart_from_limits(tiny: Tiny) -> None:
    line = explain(tiny(("slow", 3, 0.8, 1.0)))
    assert "1 detectors, the fastest (m:slow) one frame in 3" in line
    assert "\n" not in line


def test_a_problem_with_a_plan_has_nothing_to_explain(tiny: Tiny) -> None:
    with pytest.raises(ValueError, match="has a plan"):
        explain(tiny(("fast", 1, 0.8, 2.0)))


def test_with_many_detectors_the_set_is_minimal_and_proven(paper_instance: Callable[..., Problem]) -> None:
    """200 detectors: a stream cannot be tried with all of them, and need not be."""
    problem = paper_instance(4, 2, 6)
    narrow = replace(problem, link_bps={**problem.link_bps, **{("v1", site): 1e4 for site in "abcd"}})
    found = explanation.explain(narrow)
    assert found.proven
    assert found.limits == (
        "the links of stream v1 (0.01 Mbps to a, 0.01 Mbps to b, 0.01 Mbps to c, 0.01 Mbps to d)",
    )
    assert found.changes == ("a link of 0.05 Mbps from stream v1 to b",)
