"""Covering patterns: the published counts, and that phases really cover."""

from __future__ import annotations

import itertools
import math

import pytest

from pipeline.allocation.covering import MAX_MULTISETS, covering_patterns, phases_of
from pipeline.errors import NoPlanError


@pytest.mark.parametrize(("per_stream", "patterns"), [(1, 1), (2, 4), (3, 10), (4, 28), (5, 52)])
def test_the_number_of_patterns_at_two_detectors_per_frame_is_the_known_one(
    per_stream: int, patterns: int
) -> None:
    assert len(covering_patterns(tuple(range(1, per_stream + 1)), per_stream, 2)) == patterns


def looks(pattern: tuple[int, ...], phases: tuple[int, ...]) -> list[int]:
    frames = range(math.lcm(*pattern))
    return [sum(f % p == phase for p, phase in zip(pattern, phases, strict=True)) for f in frames]


@pytest.mark.parametrize("per_frame", [1, 2, 3])
def test_a_multiset_is_a_pattern_exactly_if_some_phases_cover_every_frame(per_frame: int) -> None:
    found = covering_patterns((1, 2, 3, 4, 6), 4, per_frame)
    for n in range(1, 5):
        for pattern in itertools.combinations_with_replacement((1, 2, 3, 4, 6), n):
            covers = any(
                min(looks(pattern, phases)) >= 1 and max(looks(pattern, phases)) <= per_frame
                for phases in itertools.product(*map(range, pattern))
            )
            assert (pattern in found) == covers, pattern


def test_the_phases_of_a_pattern_cover_within_the_limit() -> None:
    for pattern in covering_patterns((1, 2, 3, 4, 5), 5, 2):
        phases = phases_of(pattern, 2)
        assert phases is not None
        assert set(looks(pattern, phases)) <= {1, 2}


def test_what_cannot_cover_has_no_phases() -> None:
    assert phases_of((2, 3), 2) is None
    assert phases_of((3, 3), 2) is None
    assert phases_of((1, 1), 1) is None


def test_too_many_multisets_are_refused_by_name() -> None:
    with pytest.raises(NoPlanError, match=f"more than {MAX_MULTISETS}; lower detectors_per_stream"):
        covering_patterns(tuple(range(1, 17)), 16, 2)
