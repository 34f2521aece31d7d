"""Waits between attempts grow, to a bound, and are left to chance by a share."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.link.backoff import BackoffParams, wait_s


def test_waits_double_up_to_the_longest() -> None:
    params = BackoffParams(first_s=0.1, most_s=1.0, growth=2.0, jitter=0.5)
    assert [wait_s(params, k, 0.0) for k in range(6)] == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.0, 1.0])
    assert [wait_s(params, k, 1.0) for k in range(6)] == pytest.approx([0.05, 0.1, 0.2, 0.4, 0.5, 0.5])


@given(
    st.floats(0.01, 1.0),
    st.floats(1.0, 60.0),
    st.floats(1.0, 4.0),
    st.integers(0, 10**6),
    st.floats(0.0, 1.0),
)
def test_any_attempt_waits_a_share_of_a_wait_that_never_shrinks(
    first_s: float, most_s: float, growth: float, attempt: int, chance: float
) -> None:
    params = BackoffParams(first_s, most_s, growth, 0.25)
    whole_s = wait_s(params, attempt, 0.0)
    assert first_s * 0.999 <= whole_s <= most_s
    assert whole_s <= wait_s(params, attempt + 1, 0.0)
    assert wait_s(params, attempt, chance) == pytest.approx(whole_s * (1.0 - 0.25 * chance))


@pytest.mark.parametrize(
    "wrong", [{"first_s": 0.0}, {"most_s": 0.01}, {"growth": 0.5}, {"jitter": 1.5}, {"most_s": float("inf")}]
)
def test_waits_that_make_no_sense_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="expected 0 < first_s <= most_s"):
        BackoffParams(**wrong)
