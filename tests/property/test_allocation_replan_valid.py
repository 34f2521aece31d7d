"""Whatever changed between the running plan and the problem: a plan made again keeps every limit."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_allocation_decomposed_optimality import problems

from pipeline.allocation import decomposed
from pipeline.allocation import replan as replanning
from pipeline.allocation.problem import Deadline, Problem
from pipeline.allocation.replan import replan
from pipeline.allocation.validate import validate
from pipeline.sensor.setup import Setup

QUIET = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow], "derandomize": True}
CODECS = ("h264", "h265", "av1")


def problems_of_every_kind() -> st.SearchStrategy[Problem]:
    return problems().flatmap(dressed)


@st.composite
def dressed(draw: st.DrawFn, problem: Problem) -> Problem:
    """The same with other levels, codecs, setups and deadline, each now and then."""
    count = draw(st.sampled_from((len(problem.bitrates_bps), 1, 2)))
    bitrates = tuple(sorted(draw(st.permutations((1e6, 2e6, 3e6, 4e6)))[:count]))
    codecs = draw(st.sampled_from(((), (), CODECS)))[:count]
    if codecs and len(set(bitrates)) == len(bitrates) and draw(st.booleans()):
        bitrates = (bitrates[0],) * count  # one bitrate, several codecs
    detectors = tuple(
        replace(d, accuracy=d.accuracy[:count], setup=draw(st.sampled_from((d.setup, Setup(threads=2)))))
        for d in problem.detectors
    )
    return replace(
        problem,
        bitrates_bps=bitrates,
        codecs=codecs,
        detectors=detectors,
        stream_accuracy={pair: row[:count] for pair, row in problem.stream_accuracy.items()},
        deadline=draw(st.sampled_from((problem.deadline, None, Deadline(0.35, 0.02, 0.01, 2.0)))),
    )


@st.composite
def changed(draw: st.DrawFn, problem: Problem) -> Problem:
    """Some of it otherwise: machines lost, streams gone, periods, limits, links to 0."""
    lost = draw(st.sets(st.sampled_from([m.id for m in problem.machines]), max_size=3))
    gone = draw(st.sets(st.sampled_from(problem.streams), max_size=len(problem.streams)))
    cut = draw(st.sets(st.sampled_from(sorted(problem.link_bps)), max_size=2))
    narrow = draw(st.sampled_from((1.0, 0.5, 0.3)))  # two substreams that fit alone do not fit together
    factor = draw(st.sampled_from((1, 1, 2, 3)))
    return replace(
        problem,
        streams=tuple(v for v in problem.streams if v not in gone),
        machines=tuple(m for m in problem.machines if m.id not in lost),
        detectors=tuple(
            replace(d, period=max(1, d.period * factor // draw(st.sampled_from((1, 2)))))
            for d in problem.detectors
            if d.machine not in lost
        ),
        link_bps={pair: 0.0 if pair in cut else bps * narrow for pair, bps in problem.link_bps.items()},
        detectors_per_frame=draw(st.sampled_from((problem.detectors_per_frame, 1, 2, 3))),
        detectors_per_stream=draw(st.sampled_from((problem.detectors_per_stream, 1, 2, 4))),
        memory_rule=draw(st.sampled_from((problem.memory_rule, "one_detector_per_machine"))),
    )


def holds(before: Problem, after: Problem, loss: float) -> None:
    """Valid by itself: the fresh plan that would take the place of an invalid one is not to be had here."""
    running = decomposed.solve(before, time_limit_s=20.0).assignments
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(replanning, "solve", None)
        found = replan(after, running, loss=loss, time_limit_s=20.0)
    assert validate(after, found.plan) == []
    assert found.kept + found.ended == len(running)
    assert found.kept + found.begun == len(found.plan.assignments)


@settings(max_examples=120, **QUIET)
@given(problems_of_every_kind(), problems_of_every_kind(), st.sampled_from((0.0, 0.2, 1.0)))
def test_a_plan_of_any_problem_made_again_for_any_other_is_valid(
    before: Problem, after: Problem, loss: float
) -> None:
    holds(before, after, loss)


@settings(max_examples=200, **QUIET)
@given(st.data(), problems_of_every_kind(), st.sampled_from((0.0, 0.2, 1.0)))
def test_a_plan_made_again_for_a_changed_problem_is_valid(
    data: st.DataObject, before: Problem, loss: float
) -> None:
    holds(before, data.draw(changed(before)), loss)
