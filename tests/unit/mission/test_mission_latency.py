"""Where a result's time went: every part has its hop, the parts are the whole, and each is counted where it was."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.fusion.sequencer import Sequencer
from pipeline.messages import CameraPose, Detections, EndOfStream, Hops
from pipeline.mission.stages.latency import HOPS, LATENCY_BUCKETS_S, HopHistogram, on_its_way
from pipeline.mission.stages.reducer import ReducerStage

SECONDS = st.floats(0.0, 200.0)
NOTHING = np.zeros((0, 4)), np.zeros(0), np.zeros(0, dtype=np.int64)


def result(hops: Hops) -> Detections:
    return Detections("v", "d", 0, 0, CameraPose(np.zeros(3), np.eye(3)), *NOTHING, hops)


@given(st.lists(SECONDS, min_size=1, max_size=50), st.floats(0.0, 1.0))
def test_so_many_values_do_not_exceed_the_bound_that_is_told_and_fewer_the_one_below(
    values: list[float], share: float
) -> None:
    histogram = HopHistogram()
    for value in values:
        histogram.observe(value)
    bound = histogram.at_most_s(share)
    assert bound is not None
    assert sum(value <= bound for value in values) >= share * len(values)
    below = max((b for b in LATENCY_BUCKETS_S if b < bound), default=None)
    if below is not None:
        assert sum(value <= below for value in values) < max(1, math.ceil(share * len(values)))
    assert histogram.mean_s == pytest.approx(np.mean(values))


def test_of_no_value_nothing_is_told() -> None:
    assert (HopHistogram().mean_s, HopHistogram().at_most_s(0.5)) == (None, None)


@given(*[st.floats(0.0, 10.0)] * 6, st.integers(0, 10**10), st.integers(0, 10**10))
def test_capture_to_map_is_the_sum_of_the_parts_and_own_is_what_is_neither_work_nor_link_nor_order(
    encode: float,
    transfer: float,
    decode: float,
    detect: float,
    source: float,
    wait: float,
    back: int,
    hold: int,
) -> None:
    answered = result(Hops(encode, transfer, decode, detect, source, wait, answered_ns=1))
    seconds = on_its_way(answered, 1 + back, 1 + back + hold)
    assert set(seconds) == set(HOPS)
    parts = [seconds[hop] for hop in HOPS if hop not in ("own", "capture_to_map")]
    assert seconds["capture_to_map"] == pytest.approx(sum(parts))
    assert seconds["own"] == pytest.approx(source + wait + back * 1e-9)
    assert seconds["hold"] == pytest.approx(hold * 1e-9)


def test_where_nobody_looked_at_a_clock_nothing_is_made_up() -> None:
    plain = {"source", "encode", "transfer", "wait", "decode", "detect"}
    assert set(on_its_way(result(Hops(answered_ns=5)), None, 0)) == plain
    assert set(on_its_way(result(Hops()), 7, 9)) == plain


def test_the_reducer_times_what_comes_by_its_clock_and_without_one_only_what_the_result_says() -> None:
    timed, untimed = reducer(), reducer()
    times_ns = iter([300, 5_000_000_300])
    timed.utc_ns = lambda: next(times_ns)
    for stage in (timed, untimed):
        stage.push(result(Hops(detect_s=0.25, answered_ns=100)))
        stage.push(EndOfStream("v", "d", 0, 1))
    of_timed, of_untimed = timed.hops["v", "d"], untimed.hops["v", "d"]
    assert of_timed["return"].mean_s == pytest.approx(200e-9)
    assert of_timed["hold"].mean_s == pytest.approx(5.0)
    assert of_timed["capture_to_map"].mean_s == pytest.approx(5.25, abs=1e-6)
    assert of_untimed["detect"].mean_s == 0.25
    assert of_untimed["hold"].mean_s is None


def reducer() -> ReducerStage:
    class NoMap:
        def apply(self, result: Detections) -> None:
            """Nothing is mapped."""

    return ReducerStage(NoMap(), Sequencer([("v", "d")], None, {"v": 0}), [("v", "d")])  # type: ignore[arg-type]
