"""Counts never fall: not with a process that is replaced, not with what is taken back."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from actors.steady_counts import SteadyCounts


@given(st.lists(st.tuples(st.integers(0, 50), st.integers(1, 4)), max_size=40))
def test_a_count_never_falls_whoever_counts(said: list[tuple[int, int]]) -> None:
    steady = SteadyCounts()
    shown = [steady.of("k", value, process) for value, process in said]
    assert shown == sorted(shown)


def test_what_a_process_counted_that_is_gone_is_added_to_what_its_next_one_counts() -> None:
    steady = SteadyCounts()
    assert [steady.of("bytes", v, p) for v, p in ((10, 1), (25, 1), (0, 2), (5, 2), (3, 7))] == [
        10,
        25,
        25,
        30,
        33,
    ]


def test_keys_are_counted_for_themselves() -> None:
    steady = SteadyCounts()
    assert (steady.of("a", 5), steady.of("b", 2), steady.of("a", 6)) == (5, 2, 6)


@given(st.lists(st.tuples(st.floats(0.01, 3.0), st.integers(0, 20)), min_size=1, max_size=40))
def test_what_is_settled_never_falls_and_is_no_more_than_was_said_all_that_time(
    said: list[tuple[float, int]],
) -> None:
    steady, now, shown, history = SteadyCounts(settle_s=5.0), 100.0, [], []
    for after, value in said:
        now += after
        shown.append(steady.settled("k", value, now))
        history.append((now, value))
        most = max(
            (min(v for t, v in history[i:] if t <= end) for i, (_, _) in enumerate(history) for end in [now]),
            default=0,
        )
        assert shown[-1] <= max(most, *(s for s in shown))
    assert shown == sorted(shown)


def test_a_frame_that_one_detector_drops_and_another_looks_at_later_was_never_counted_as_dropped() -> None:
    steady = SteadyCounts(settle_s=5.0)
    assert [
        steady.settled("dropped", v, t) for t, v in ((0.0, 1), (1.0, 2), (2.0, 1), (6.0, 1), (8.0, 1))
    ] == [0, 0, 0, 1, 1]
