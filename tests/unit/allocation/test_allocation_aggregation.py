"""What is interchangeable, and what is not."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from pipeline.allocation.aggregation import UNLIMITED, aggregate
from pipeline.allocation.problem import Deadline, Problem

Paper = Callable[[int, int, int], Problem]


def test_the_papers_forty_machines_are_three_groups_and_its_streams_one_class(paper_instance: Paper) -> None:
    found = aggregate(paper_instance(5, 50, 9))
    assert [len(g.machines) for g in found.groups] == [10, 10, 10]  # the ten of type A run nothing
    assert len(found.kinds) == 21
    assert all(kind.copies == 5 for kind in found.kinds)
    assert [len(c.streams) for c in found.classes] == [50]


def test_machines_kept_apart_are_groups_of_their_own(paper_instance: Paper) -> None:
    found = aggregate(paper_instance(2, 1, 6), apart=frozenset({"b0", "b1"}))
    assert sorted(len(g.machines) for g in found.groups) == [1, 1, 8, 10, 10]


def test_a_stream_with_its_own_link_accuracy_or_plan_is_a_class_of_its_own(paper_instance: Paper) -> None:
    problem = paper_instance(2, 4, 6)
    other_link = replace(problem, link_bps={**problem.link_bps, ("v1", "b"): 5e5})
    assert [c.streams for c in aggregate(other_link).classes] == [("v0", "v2", "v3"), ("v1",)]
    other_accuracy = replace(problem, stream_accuracy={("v2", "ssd_i"): (0.1,) * 6})
    assert [c.streams for c in aggregate(other_accuracy).classes] == [("v0", "v1", "v3"), ("v2",)]
    kept = frozenset({("v3", "b0:ssd_i", 1e6, "")})
    assert [c.streams for c in aggregate(problem, kept=kept).classes] == [("v0", "v1", "v2"), ("v3",)]


def test_a_level_that_no_link_carries_or_that_comes_too_late_is_not_allowed(paper_instance: Paper) -> None:
    problem = paper_instance(1, 1, 6)
    links = {("v0", "b"): 2.5e5, ("v0", "c"): math.inf}
    (narrow,) = aggregate(replace(problem, link_bps=links)).classes
    sites = [kind.site for kind in aggregate(problem).kinds]
    assert narrow.capacity.tolist() == [0, 250_000, UNLIMITED, 0]
    for site, allowed in zip(sites, narrow.allowed, strict=True):
        assert allowed.tolist() == [site == 2 or (site == 1 and b <= 3) for b in range(6)]
    late = replace(problem, deadline=Deadline(limit_s=0.04, encode_s=0.0, decode_s=0.0, burst=1.0))
    (timely,) = aggregate(late).classes
    # a frame of 1 Mbps at 30 Hz takes 33 ms of a link of 1 Mbps, execution another 33
    assert timely.allowed[0].tolist() == [True, True, True, False, False, False]
