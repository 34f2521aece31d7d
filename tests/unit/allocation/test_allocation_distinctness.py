"""Detectors that fit by size, but not without one stream using a detector twice."""

from __future__ import annotations

import math

import pytest

from pipeline.allocation import decomposed, distinctness, literal
from pipeline.allocation.problem import Detector, MachineLimit, Problem
from pipeline.allocation.validate import validate

GB = 1e9


def problem(streams: tuple[str, ...], own_links: bool) -> Problem:
    """Two machines of 6 GB. ``good`` sees every second frame and takes 3 GB, ``fast`` every frame and 2 GB.

    By size the two good ones of one stream fit on the one machine and three fast ones on the other; but the
    two must lie on different machines, and beside each only one fast one fits.
    """
    machines = ("m", "n")
    return Problem(
        streams=streams,
        sites=("s",),
        machines=tuple(MachineLimit(m, "s", 6 * GB) for m in machines),
        detectors=tuple(
            Detector(f"{m}:{name}", name, m, "s", period, gb * GB, (accuracy,), period / 10)
            for m in machines
            for name, period, gb, accuracy in (("good", 2, 3, 0.9), ("fast", 1, 2, 0.3))
        ),
        bitrates_bps=(1e6,),
        link_bps={(v, "s"): math.inf if not own_links else 2e6 + i for i, v in enumerate(streams)},
        frame_rate_hz=10.0,
        detectors_per_stream=2,
        detectors_per_frame=1,
        accuracy_weight=1.0,
    )


@pytest.mark.parametrize("own_links", [False, True])
@pytest.mark.parametrize("streams", [3, 4])
def test_a_stream_never_uses_one_detector_twice_and_the_optimum_is_the_papers(
    streams: int, own_links: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[object] = []
    real = distinctness.tell_apart
    monkeypatch.setattr(decomposed, "tell_apart", lambda *a: told.append(a) or real(*a))
    stated = problem(tuple("uvwx")[:streams], own_links)
    plan = decomposed.solve(stated, time_limit_s=20.0)
    wanted = literal.solve(stated, time_limit_s=20.0)
    assert (plan.status, plan.gap) == ("optimal", 0.0)
    assert plan.objective == pytest.approx(wanted.objective)
    assert validate(stated, plan) == []
    assert bool(told) == (streams == 4)  # with three streams the first packing is right


def test_without_listed_patterns_the_machines_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    from pipeline.allocation import memory

    monkeypatch.setattr(memory, "MAX_PATTERNS", 0)
    stated = problem(("u", "v", "w", "x"), own_links=True)
    plan = decomposed.solve(stated, time_limit_s=20.0)
    assert plan.objective == pytest.approx(literal.solve(stated, time_limit_s=20.0).objective)
    assert validate(stated, plan) == []
