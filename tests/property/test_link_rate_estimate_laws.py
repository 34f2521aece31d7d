"""The estimate against a link whose rate is known: a fluid in steps of a millisecond, no socket, no clock."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.link.rate_estimate import RateEstimate

STEP_S = 0.001
DECLARED_BPS = 6e6


@dataclass
class Fluid:
    """A sender that keeps to the declared rate, a kernel that holds 100 ms of it, a link, and a far end that says every
    50 ms, or every 32 KB, what it has read; delay_s each way.
    """

    rate_bps: Callable[[float], float]
    offered_bps: float
    frame_hz: float = 10.0
    delay_s: float = 0.0
    declared_bps: float = DECLARED_BPS
    large_every: int = 0  # frame of so many is as large as the others of so many together
    estimate: RateEstimate = field(init=False)

    def __post_init__(self) -> None:
        self.estimate = RateEstimate(self.declared_bps)
        self.now_s = 0.0
        self.waiting = self.held = self.passed = 0.0
        self.tokens = self.burst = 0.05 * self.declared_bps / 8
        self.offered = self.next_frame_s = 0.0
        self.said, self.said_s, self.read = 0, 0.0, 0
        self.coming: list[tuple[float, int, float]] = []
        self.frame = 0
        self.begun: list[list[float]] = []  # end, bytes, beginning

    def run(self, until_s: float) -> None:
        while self.now_s < until_s:
            self.step()

    def step(self) -> None:
        self.now_s += STEP_S
        if self.now_s >= self.next_frame_s:
            self.next_frame_s += 1.0 / self.frame_hz
            nbytes = self.offered_bps / self.frame_hz / 8
            if self.large_every:
                nbytes *= 0.5 if self.frame % self.large_every else 0.5 * self.large_every
            self.frame += 1
            if (
                self.waiting + self.held < self.estimate.rate_bps(self.now_s) / 8
            ):  # a second; else it is dropped
                self.waiting += nbytes
                self.offered += nbytes
                self.begun.append([self.offered, nbytes, math.nan])
        self._write()
        self._pass()
        while self.coming and self.coming[0][0] <= self.now_s:
            _, nbytes, at_s = self.coming.pop(0)
            self.estimate.read(nbytes, at_s)
            self.read += nbytes
            while self.begun and self.begun[0][0] <= self.read + 1.0:
                _, size, begun_s = self.begun.pop(0)
                self.estimate.passed(int(size), at_s + self.delay_s - begun_s, at_s)

    def _write(self) -> None:
        self.tokens = min(self.burst, self.tokens + self.declared_bps / 8 * STEP_S)
        room = 0.1 * max(self.estimate.rate_bps(self.now_s), 3e5) / 8 - self.held
        wanted = min(self.waiting, self.tokens)
        taken = max(0.0, min(wanted, room))
        self.waiting -= taken
        self.tokens -= taken
        self.held += taken
        for message in self.begun:
            if math.isnan(message[2]) and self.passed + self.held > message[0] - message[1]:
                message[2] = self.now_s
        if taken < wanted:
            self.estimate.blocked(self.now_s)
        else:
            self.estimate.free(self.now_s)

    def _pass(self) -> None:
        through = min(self.held, self.rate_bps(self.now_s) / 8 * STEP_S)
        self.held -= through
        self.passed += through
        news = int(self.passed) - self.said
        since_s = self.now_s - self.said_s
        if (news >= 32 * 1024 and since_s >= 0.01) or (news and since_s >= 0.05):
            self.coming.append((self.now_s + 2 * self.delay_s, news, self.now_s))
            self.said, self.said_s = int(self.passed), self.now_s


def changing(*rates_bps: float, at_s: float) -> Callable[[float], float]:
    """One rate after the other, each for at_s seconds."""
    return lambda now_s: rates_bps[min(len(rates_bps) - 1, int(now_s / at_s))]


@pytest.mark.parametrize("real_bps", [3e6, 1e6, 0.5e6])
def test_a_link_worse_than_declared_is_known_within_two_seconds(real_bps: float) -> None:
    fluid = Fluid(changing(6e6, real_bps, at_s=5.0), offered_bps=4e6)
    fluid.run(5.0)
    assert fluid.estimate.rate_bps(5.0) == pytest.approx(6e6, rel=0.01)
    fluid.run(7.0)
    assert fluid.estimate.rate_bps(7.0) == pytest.approx(real_bps, rel=0.1)
    assert fluid.estimate.is_full(7.0)


@pytest.mark.parametrize("again_bps", [1e6, 2e6, 3e6])
def test_a_link_that_recovers_below_what_is_offered_is_known_within_two_seconds(again_bps: float) -> None:
    fluid = Fluid(changing(0.5e6, again_bps, at_s=5.0), offered_bps=4e6)
    fluid.run(7.0)
    assert fluid.estimate.rate_bps(7.0) == pytest.approx(again_bps, rel=0.1)


def test_a_link_that_recovers_beyond_what_is_offered_is_known_to_carry_it() -> None:
    fluid = Fluid(changing(0.5e6, 6e6, at_s=5.0), offered_bps=4e6)
    fluid.run(7.0)
    assert fluid.estimate.rate_bps(7.0) >= 0.95 * 4e6
    assert not fluid.estimate.is_full(7.0)


rates = st.floats(0.25e6, 5e6)


@settings(max_examples=25, deadline=None)
@given(rates, rates, st.floats(0.0, 0.1), st.sampled_from([2.0, 5.0, 10.0, 30.0]))
def test_while_more_is_offered_than_passes_the_estimate_is_what_passes(
    first_bps: float, then_bps: float, delay_s: float, frame_hz: float
) -> None:
    fluid = Fluid(
        changing(first_bps, then_bps, at_s=4.0), offered_bps=8e6, frame_hz=frame_hz, delay_s=delay_s
    )
    fluid.run(6.0 + 2 * delay_s)
    assert fluid.estimate.rate_bps(fluid.now_s) == pytest.approx(then_bps, rel=0.1)


@settings(max_examples=25, deadline=None)
@given(
    st.floats(0.01e6, 5.5e6),
    st.floats(6e6, 100e6),
    st.floats(0.0, 0.3),
    st.sampled_from([1.0, 2.0, 10.0, 30.0]),
)
def test_little_offered_never_lowers_the_estimate(
    offered_bps: float, real_bps: float, delay_s: float, frame_hz: float
) -> None:
    fluid = Fluid(lambda _: real_bps, offered_bps, frame_hz, delay_s)
    for second in range(1, 7):
        fluid.run(float(second))
        assert fluid.estimate.rate_bps(fluid.now_s) == DECLARED_BPS


@settings(max_examples=20, deadline=None)
@given(rates, st.floats(0.05, 0.8), st.floats(0.0, 0.1))
def test_a_limit_that_was_found_is_kept_while_less_is_offered(
    real_bps: float, share: float, delay_s: float
) -> None:
    """Or a plan that fits the link would be given up at once for one that does not, again and again."""
    fluid = Fluid(lambda _: real_bps, offered_bps=8e6, delay_s=delay_s)
    fluid.run(4.0)
    fluid.offered_bps = share * real_bps
    fluid.run(12.0)
    # little frames pass at once while the link is idle, so it may seem better than it is, but never worse
    assert 0.9 * real_bps <= fluid.estimate.rate_bps(12.0) <= 1.15 * real_bps


@settings(max_examples=20, deadline=None)
@given(rates, st.floats(0.0, 0.1))
def test_the_backlog_is_the_time_that_the_real_link_needs(real_bps: float, delay_s: float) -> None:
    fluid = Fluid(lambda _: real_bps, offered_bps=8e6, delay_s=delay_s)
    fluid.run(5.0)
    unread = fluid.waiting + fluid.held
    told_s = fluid.estimate.backlog_s(round(unread), fluid.now_s)
    assert told_s == pytest.approx(unread * 8 / real_bps, rel=0.1, abs=0.02)


def test_a_link_that_stands_still_is_known_as_such_and_so_is_its_return() -> None:
    fluid = Fluid(changing(6e6, 1.0, 6e6, at_s=4.0), offered_bps=4e6)
    fluid.run(6.0)
    assert fluid.estimate.rate_bps(6.0) < 0.1e6
    assert fluid.estimate.backlog_s(100_000, 6.0) > 8.0
    fluid.run(10.0)
    assert fluid.estimate.rate_bps(10.0) >= 0.95 * 4e6


@settings(max_examples=20, deadline=None)
@given(rates, st.floats(0.0, 0.02))
def test_a_link_that_is_good_again_is_known_by_its_key_frames_though_all_that_is_offered_fits(
    real_bps: float, delay_s: float
) -> None:
    """Or a plan that fits a poor link would be kept for ever."""
    fluid = Fluid(changing(real_bps, 20e6, at_s=4.0), offered_bps=8e6, delay_s=delay_s, large_every=20)
    fluid.run(3.0)
    fluid.offered_bps = 0.85 * real_bps
    fluid.run(6.5)
    assert fluid.estimate.rate_bps(6.5) > min(1.5 * real_bps, 0.9 * DECLARED_BPS)


def test_a_message_that_a_shaper_lets_through_at_once_says_nothing() -> None:
    estimate = RateEstimate(6e6)
    estimate._rate_bps = 0.5e6
    estimate.passed(12_000, 0.001, 1.0)
    assert estimate.rate_bps(1.0) == 0.5e6
    estimate.passed(30_056, 0.12, 1.0)
    assert estimate.rate_bps(1.0) == pytest.approx(1.6e6)
    estimate.blocked(2.0)
    for step in range(10):
        estimate.read(10_000, 2.0 + step * 0.1)
    estimate.passed(300_000, 0.1, 2.9)
    assert estimate.rate_bps(2.9) == pytest.approx(0.8e6), "a full link is known by its mean"


def test_nothing_unread_is_no_backlog_and_a_link_without_a_limit_has_none() -> None:
    assert RateEstimate(1e6).backlog_s(0, 0.0) == 0.0
    assert RateEstimate(1e6).backlog_s(125_000, 0.0) == pytest.approx(1.0)
    assert RateEstimate(float("inf")).backlog_s(10**9, 0.0) == 0.0


@pytest.mark.parametrize("declared_bps", [0.0, -1.0, float("nan")])
def test_a_link_that_is_declared_to_carry_nothing_is_refused(declared_bps: float) -> None:
    with pytest.raises(ValueError, match="a link of"):
        RateEstimate(declared_bps)
