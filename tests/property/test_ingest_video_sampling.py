"""Laws of the processing clock on a video."""

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pipeline.ingest.sampling import sampled, sampled_indices

rates = st.fractions(min_value=Fraction(1, 2), max_value=120, max_denominator=1001)
gaps = st.lists(st.floats(0.001, 5.0), max_size=200)


@dataclass
class Shown:
    time_s: float


def constant(frames: int, video_hz: Fraction, processing_hz: Fraction) -> list[int]:
    interval_s = 1.0 / float(video_hz)
    times_s = np.arange(frames) * interval_s
    return sampled_indices(times_s, float(processing_hz), 1e-6 * interval_s, interval_s).tolist()


@given(st.integers(0, 2000), rates, rates)
def test_at_a_constant_rate_each_tick_gets_the_last_picture_that_is_not_after_it(
    frames: int, one_hz: Fraction, other_hz: Fraction
) -> None:
    video_hz, processing_hz = max(one_hz, other_hz), min(one_hz, other_hz)
    exact = []
    while (index := math.floor(len(exact) * video_hz / processing_hz)) < frames:
        exact.append(index)
    assert constant(frames, video_hz, processing_hz) == exact


@given(gaps, st.floats(0.2, 60.0))
def test_whatever_the_times_no_picture_and_no_tick_is_taken_twice(
    gaps_s: list[float], rate_hz: float
) -> None:
    times_s = np.cumsum([0.0, *gaps_s])
    taken = [(s.time_s, k) for s, k in sampled(map(Shown, times_s), rate_hz, 0.0, 0.1) if k is not None]
    ticks = [k for _, k in taken]
    assert ticks == sorted(set(ticks))
    for time_s, tick in taken:
        last = times_s[times_s <= tick / rate_hz][-1]
        assert time_s == last


@given(gaps, st.floats(0.2, 60.0))
def test_an_iterator_takes_the_pictures_that_are_chosen_at_once(gaps_s: list[float], rate_hz: float) -> None:
    times_s = np.cumsum([0.0, *gaps_s])
    one_by_one = [s.time_s for s, k in sampled(map(Shown, times_s), rate_hz, 1e-4, 0.1) if k is not None]
    assert one_by_one == times_s[sampled_indices(times_s, rate_hz, 1e-4, 0.1)].tolist()
