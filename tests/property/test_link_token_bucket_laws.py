"""Laws of the token bucket over any sequence of reservations."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from pipeline.link.token_bucket import TokenBucket

rates_bps = st.floats(1e3, 1e9)
bursts = st.integers(1, 100_000)
#: (bytes, seconds since the one before)
sequences = st.lists(st.tuples(st.integers(0, 200_000), st.floats(0.0, 2.0)), min_size=1, max_size=30)


def completions(
    rate_bps: float, burst: int, sequence: list[tuple[int, float]]
) -> list[tuple[float, float, int]]:
    """(asked for, complete, bytes) of each reservation."""
    bucket, now_s, result = TokenBucket(rate_bps, burst), 0.0, []
    for nbytes, wait_s in sequence:
        now_s += wait_s
        result.append((now_s, bucket.reserve(nbytes, now_s), nbytes))
    return result


@given(rates_bps, bursts, sequences)
def test_no_window_lets_more_through_than_burst_and_rate(
    rate_bps: float, burst: int, sequence: list[tuple[int, float]]
) -> None:
    done = completions(rate_bps, burst, sequence)
    largest = max(burst, *(nbytes for _, _, nbytes in done))
    for i in range(len(done)):
        for j in range(i, len(done)):
            window_s = done[j][1] - done[i][1]
            within = sum(nbytes for _, _, nbytes in done[i : j + 1])
            assert within <= largest + rate_bps / 8 * window_s + 1e-6 * rate_bps


@given(rates_bps, bursts, sequences)
def test_completion_is_in_order_and_never_before_the_asking(
    rate_bps: float, burst: int, sequence: list[tuple[int, float]]
) -> None:
    done = completions(rate_bps, burst, sequence)
    assert all(complete >= asked for asked, complete, _ in done)
    assert all(one <= other for (_, one, _), (_, other, _) in pairwise(done))


@given(rates_bps, bursts, sequences)
def test_the_rate_is_used_in_full_while_something_waits(
    rate_bps: float, burst: int, sequence: list[tuple[int, float]]
) -> None:
    done = completions(rate_bps, burst, [(nbytes, 0.0) for nbytes, _ in sequence])
    total = sum(nbytes for _, _, nbytes in done)
    assert abs(done[-1][1] - max(0.0, (total - burst) * 8 / rate_bps)) <= 1e-9 * (1 + total * 8 / rate_bps)


@given(rates_bps, bursts, sequences, st.floats(0.0, 100.0))
def test_the_backlog_is_what_remains_until_completion(
    rate_bps: float, burst: int, sequence: list[tuple[int, float]], later_s: float
) -> None:
    bucket, now_s, complete_s = TokenBucket(rate_bps, burst), 0.0, 0.0
    for nbytes, wait_s in sequence:
        now_s += wait_s
        complete_s = bucket.reserve(nbytes, now_s)
    backlog_s = bucket.backlog_s(now_s + later_s)
    assert backlog_s >= 0.0
    assert abs(backlog_s - max(0.0, complete_s - now_s - later_s)) < 1e-9 * (1 + complete_s)
