"""Laws of the processing clock on a video."""

import math
from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from pipeline.ingest.video.file import sampled_indices

rates = st.fractions(min_value=Fraction(1, 2), max_value=120, max_denominator=1001)


@given(st.integers(0, 2000), rates, rates)
def test_each_tick_gets_the_last_picture_that_is_not_after_it(
    frames: int, one_hz: Fraction, other_hz: Fraction
) -> None:
    video_hz, processing_hz = max(one_hz, other_hz), min(one_hz, other_hz)
    exact = []
    while (index := math.floor(len(exact) * video_hz / processing_hz)) < frames:
        exact.append(index)
    assert sampled_indices(frames, float(video_hz), float(processing_hz)).tolist() == exact


@given(st.integers(0, 2000), rates, rates)
def test_pictures_are_in_order_and_never_repeated(frames: int, one_hz: Fraction, other_hz: Fraction) -> None:
    indices = sampled_indices(frames, float(max(one_hz, other_hz)), float(min(one_hz, other_hz))).tolist()
    assert indices == sorted(set(indices))
    assert all(0 <= index < frames for index in indices)
