"""The decomposed solver against the paper's program itself, on random small problems of every kind."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.allocation import decomposed, literal, memory
from pipeline.allocation.problem import Deadline, Detector, MachineLimit, Problem
from pipeline.allocation.validate import validate

BITRATES = (1e6, 2e6, 4e6)
GB = 1e9
LINKS = (math.inf, 8e6, 4e6, 3e6, 2e6, 1.5e6, 1e6, 0.5e6, 0.0)
ACCURACIES = st.tuples(*(st.integers(0, 10).map(lambda tenth: tenth / 10) for _ in BITRATES))


@st.composite
def problems(draw: st.DrawFn) -> Problem:
    """1-4 streams of 1-2 classes, 1-3 sites with 1-3 equal machines each, 1-3 networks per machine.

    Memory that is short, both memory rules; every other one with something past the paper.
    """
    sites = ("s", "t", "u")[: draw(st.integers(1, 3))]
    machines, detectors = [], []
    beyond = draw(st.sampled_from((False, False, True)))
    for site in sites:
        memory = draw(st.sampled_from((2.0, 4.0, 5.0, 7.0, math.inf))) * GB
        networks = draw(st.lists(network(beyond), min_size=1, max_size=3))
        for copy in range(draw(st.integers(1, 3))):
            machine = f"{site}{copy}"
            machines.append(MachineLimit(machine, site, memory))
            detectors += [
                replace(d, id=f"{machine}:{n}", detector=f"{site}-{n}", machine=machine, site=site)
                for n, d in enumerate(networks)
            ]
    names = [f"v{i}" for i in range(draw(st.integers(1, 4)))]
    link_classes = draw(st.lists(st.tuples(*(st.sampled_from(LINKS) for _ in sites)), min_size=1, max_size=2))
    links = {
        (v, site): of_class[s]
        for i, v in enumerate(names)
        for of_class in [link_classes[i % len(link_classes)]]
        for s, site in enumerate(sites)
    }
    return Problem(
        streams=tuple(names),
        sites=sites,
        machines=tuple(machines),
        detectors=tuple(detectors),
        bitrates_bps=BITRATES,
        link_bps=links,
        frame_rate_hz=10.0,
        detectors_per_stream=draw(st.sampled_from((2, 3, 4, 1))),
        detectors_per_frame=draw(st.sampled_from((2, 1, 3))),
        accuracy_weight=draw(st.sampled_from((0.0, 0.3, 0.6, 0.9, 1.0))),
        memory_rule=draw(st.sampled_from(("ram", "ram", "ram", "one_detector_per_machine"))),
        stream_accuracy={(names[0], f"{sites[0]}-0"): draw(ACCURACIES)} if beyond else {},
        deadline=draw(st.sampled_from((None, Deadline(0.5, 0.01, 0.01, 1.5)))) if beyond else None,
    )


@st.composite
def network(draw: st.DrawFn, beyond: bool) -> Detector:
    period = draw(st.sampled_from((1, 1, 2, 2, 3, 4)))
    memory = draw(st.sampled_from((0.0, 1.0, 2.0, 2.5, 3.0))) * GB
    sharing = draw(st.sampled_from((None, 1, 2, 3))) if beyond else None
    return Detector("", "", "", "", period, memory, draw(ACCURACIES), period / 10, sharing)


def holds(problem: Problem) -> None:
    wanted = literal.solve(problem, time_limit_s=60.0)
    plan = decomposed.solve(problem, time_limit_s=60.0)
    assert validate(problem, plan) == []
    if wanted.status == "feasible":  # the paper's program had not ended: it can only be worse
        assert wanted.objective is not None
        assert plan.status == "optimal"
        assert plan.objective is not None
        assert plan.objective >= wanted.objective - 2e-7
        return
    assert plan.status == wanted.status
    if wanted.objective is not None:
        assert plan.objective == pytest.approx(wanted.objective, abs=2e-7)
        assert plan.gap == 0.0


QUIET = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}


@settings(max_examples=200, derandomize=True, **QUIET)
@given(problems())
def test_status_and_objective_are_those_of_the_papers_program(problem: Problem) -> None:
    holds(problem)


@pytest.mark.slow
@pytest.mark.timeout(3000)
@settings(max_examples=3000, **QUIET)
@given(problems())
def test_status_and_objective_are_those_of_the_papers_program_on_many_problems(problem: Problem) -> None:
    holds(problem)


@settings(max_examples=60, derandomize=True, **QUIET)
@given(problems())
def test_machines_with_too_many_patterns_to_list_give_the_same_optimum(problem: Problem) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(memory, "MAX_PATTERNS", 0)
        holds(problem)


@settings(max_examples=40, derandomize=True, **QUIET)
@given(problems(), st.lists(ACCURACIES, min_size=4, max_size=4))
def test_codecs_are_levels_too(problem: Problem, accuracies: list[tuple[float, ...]]) -> None:
    """Every bitrate with two codecs; each detector is better under the one or the other."""
    levels = tuple(bps for bps in problem.bitrates_bps for _ in range(2))
    detectors = tuple(
        replace(d, accuracy=tuple(x for pair in zip(d.accuracy, other, strict=True) for x in pair))
        for d, other in zip(problem.detectors, accuracies * 7, strict=False)
    )
    holds(
        replace(
            problem,
            bitrates_bps=levels,
            detectors=detectors,
            codecs=("h264", "h265") * len(BITRATES),
            stream_accuracy={},
        )
    )
