"""When pictures were taken, from what senders say of it."""

from __future__ import annotations

import math
import random

import pytest

from pipeline.ingest.live.capture_clock import CaptureClock, CaptureClockParams

#: where the sender's presentation times begin
_ZERO_S = 812.0


def _hear(clock: CaptureClock, at_s: float, delay_s: float, zero_s: float = _ZERO_S) -> float:
    clock.heard(zero_s + at_s, at_s + delay_s)
    return clock.taken_s(zero_s + at_s)


def test_without_a_word_of_the_sender_the_least_delay_of_the_last_seconds_counts() -> None:
    clock, random_s = CaptureClock(), random.Random(5)
    for k in range(200):
        delay_s = 0.2 + random_s.expovariate(10.0) * (k % 20 != 0)
        taken_s = _hear(clock, 0.1 * k, delay_s)
        if k > 50:
            assert taken_s == pytest.approx(0.1 * k + 0.2, abs=1e-9)
    assert clock.basis == "arrival"


@pytest.mark.parametrize("basis", ["ntp", "klv"])
@pytest.mark.parametrize("ahead_s", [0.0, -1.5, 0.2])
def test_what_the_sender_says_counts_whatever_the_delay(basis: str, ahead_s: float) -> None:
    clock = CaptureClock()
    for k in range(20):
        at_s = 0.1 * k
        clock.heard(_ZERO_S + at_s, at_s + 0.4)
        clock.refer(basis, _ZERO_S + at_s, at_s + ahead_s, at_s + 0.4)  # type: ignore[arg-type]
        assert clock.taken_s(_ZERO_S + at_s) == pytest.approx(at_s + ahead_s, abs=1e-9)
    assert clock.basis == basis


@pytest.mark.parametrize("off_s", [3600.0, 1.0, -11.0, -1.7e9, math.nan])
def test_a_clock_that_cannot_be_right_is_not_believed_and_that_is_known(off_s: float) -> None:
    clock = CaptureClock()
    clock.heard(_ZERO_S, 0.3)
    clock.refer("ntp", _ZERO_S, 0.3 + off_s, 0.3)
    assert clock.basis == "arrival"
    assert clock.taken_s(_ZERO_S) == pytest.approx(0.3)
    assert clock.refused_s == (0.0 if math.isnan(off_s) else pytest.approx(off_s))


def test_one_wrong_reference_among_many_changes_nothing() -> None:
    clock = CaptureClock()
    for k in range(9):
        clock.heard(_ZERO_S + k, k + 0.2)
        clock.refer("klv", _ZERO_S + k, k - (5.0 if k == 4 else 0.0), k + 0.2)
    assert clock.taken_s(_ZERO_S + 8) == pytest.approx(8.0)


def test_pictures_that_come_in_a_burst_after_a_stall_keep_their_times() -> None:
    clock = CaptureClock()
    for k in range(50):
        _hear(clock, 0.1 * k, 0.2)
    # what was filmed meanwhile comes within a fifth of a second
    for k in range(50, 150):
        clock.heard(_ZERO_S + 0.1 * k, 15.0 + 0.002 * (k - 50) + 0.2)
        if k - 50 < 10:
            continue  # the window has forgotten what was before
    assert _hear(clock, 15.2, 0.2) == pytest.approx(15.4, abs=0.01)


@pytest.mark.parametrize("anew_s", [0.0, 5000.0, 812.05])
def test_a_sender_that_began_anew_is_noticed_at_once_if_its_times_go_back(anew_s: float) -> None:
    clock = CaptureClock()
    for k in range(50):
        _hear(clock, 0.1 * k, 0.2)
    for k in range(60):
        taken_s = _hear(clock, 8.0 + 0.1 * k, 0.2, anew_s - 8.0)
        if anew_s < _ZERO_S or k > 55:
            assert taken_s == pytest.approx(8.2 + 0.1 * k, abs=1e-6)


def test_a_connection_forgets_what_the_one_before_it_said() -> None:
    clock = CaptureClock()
    clock.heard(_ZERO_S, 0.2)
    clock.refer("ntp", _ZERO_S, 0.0, 0.2)
    clock.restart()
    assert (clock.basis, math.isnan(clock.taken_s(_ZERO_S))) == ("arrival", True)


def test_an_operator_may_say_that_arrivals_count() -> None:
    clock = CaptureClock(CaptureClockParams(), believes=False)
    clock.heard(_ZERO_S, 0.2)
    clock.refer("ntp", _ZERO_S, 0.0, 0.2)
    assert (clock.basis, clock.refused_s) == ("arrival", 0.0)
