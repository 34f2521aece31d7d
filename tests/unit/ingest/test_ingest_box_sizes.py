"""Sizes of boxes: right flights are believed, and a wrong height or focal length is named with its factor."""

from __future__ import annotations

import re
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.ingest.checks.box_sizes import check_box_sizes, size_bin


def boxes(factor: float, count: int = 200, spread: float = 0.2, seed: int = 3) -> Counter[int]:
    """Sizes of people's boxes, 1.33 times a person as on right flights, and then too large by a factor."""
    ratios = 1.33 * factor * np.exp(spread * np.random.default_rng(seed).normal(size=count))
    return Counter(size_bin(float(ratio) * 12.0, 12.0) for ratio in ratios)


@given(st.integers(0, 1000), st.floats(0.85, 1.2))
def test_boxes_as_large_as_people_are_believed(seed: int, factor: float) -> None:
    assert check_box_sizes("drone.srt", boxes(factor, seed=seed)) == []


@pytest.mark.parametrize("factor", [0.35, 1.75, 2.75])
def test_a_scale_is_named_as_height_or_focal_length_with_its_factor(factor: float) -> None:
    (finding,) = check_box_sizes("drone.srt", boxes(factor))
    assert (finding.severity, finding.cause) == ("warning", "height_off/focal_length")
    stated = re.search(r"focal length ([0-9.]+) times", finding.mend)
    assert stated is not None
    assert float(stated.group(1)) == pytest.approx(factor, rel=0.07)
    assert "200 sure boxes" in finding.evidence


def test_few_boxes_say_nothing() -> None:
    assert check_box_sizes("drone.srt", boxes(3.0, count=39)) == []
    assert check_box_sizes("drone.srt", {}) == []


def test_false_boxes_of_any_size_among_them_change_nothing() -> None:
    assert check_box_sizes("drone.srt", boxes(1.0, 200) + boxes(5.0, 60)) == []
