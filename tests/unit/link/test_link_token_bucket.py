"""Worked examples of the bucket; its laws are in tests/property/test_link_token_bucket_laws.py."""

import math

import pytest

from pipeline.link.token_bucket import TokenBucket


def test_a_full_bucket_lets_its_burst_through_at_once_and_then_keeps_the_rate() -> None:
    bucket = TokenBucket(8000.0, 500)
    assert bucket.reserve(500, 10.0) == 10.0
    assert bucket.reserve(1000, 10.0) == 11.0
    assert bucket.backlog_s(10.25) == pytest.approx(0.75)
    assert bucket.reserve(100, 20.0) == 20.0


def test_a_message_larger_than_the_burst_waits_for_the_rest_and_leaves_a_debt() -> None:
    bucket = TokenBucket(8000.0, 500)
    assert bucket.reserve(2500, 0.0) == 2.0
    assert bucket.reserve(1, 2.0) == pytest.approx(2.001)


def test_an_infinite_rate_never_waits() -> None:
    bucket = TokenBucket(math.inf, 1)
    assert [bucket.reserve(10**9, t) for t in (0.0, 0.0, 3.0)] == [0.0, 0.0, 3.0]
    assert bucket.backlog_s(3.0) == 0.0


@pytest.mark.parametrize(
    ("rate_bps", "burst_bytes"), [(0.0, 1), (-1.0, 1), (math.nan, 1), (1.0, 0), (1.0, math.inf)]
)
def test_a_bucket_that_lets_nothing_or_everything_through_is_refused(
    rate_bps: float, burst_bytes: float
) -> None:
    with pytest.raises(ValueError, match="a token bucket of"):
        TokenBucket(rate_bps, burst_bytes)
