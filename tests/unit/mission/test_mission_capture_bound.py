"""A frame of tomorrow is refused; one of now, and of what clocks may be apart, is not."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from pipeline.clock import Clock
from pipeline.mission.capture_bound import CaptureBound

S = 1_000_000_000
BEGIN = 1_800_000_000 * S


def _stream(name: str, live: bool = False) -> SimpleNamespace:
    video = SimpleNamespace(start_s=5.0)
    return SimpleNamespace(stream=name, start_ns=BEGIN, end_s=65.0, video=video, is_live=live)


@pytest.fixture
def bound() -> tuple[CaptureBound, SimpleNamespace]:
    time = SimpleNamespace(now_s=100.0)
    streams = [_stream("file"), _stream("live", live=True)]
    return CaptureBound(streams, 2.0, Clock(monotonic_s=lambda: time.now_s)), time  # type: ignore[arg-type]


def test_of_recorded_video_nothing_is_newer_than_its_end(bound) -> None:  # type: ignore[no-untyped-def]
    limits, _ = bound
    assert not limits.is_beyond("file", BEGIN + 67 * S)
    for later_s in (68, 86_400, 10**9):
        assert limits.is_beyond("file", BEGIN + later_s * S)
    assert not limits.is_beyond("live", BEGIN + 10**9 * S), "nobody has said yet what is now"


def test_in_real_time_nothing_is_newer_than_now(bound) -> None:  # type: ignore[no-untyped-def]
    limits, time = bound
    limits.runs({"file": BEGIN + 10 * S, "live": BEGIN + 10 * S})
    for stream in ("file", "live"):
        assert not limits.is_beyond(stream, BEGIN + 12 * S)
        assert limits.is_beyond(stream, BEGIN + 13 * S)
        assert limits.is_beyond(stream, BEGIN + 86_400 * S)
    time.now_s += 20.0
    assert not limits.is_beyond("live", BEGIN + 32 * S)
    assert limits.is_beyond("live", BEGIN + 33 * S)


def test_a_clock_that_is_told_again_goes_on_from_there(bound) -> None:  # type: ignore[no-untyped-def]
    limits, _ = bound
    limits.runs({"live": BEGIN})
    limits.runs({"live": BEGIN + 50 * S})
    assert not limits.is_beyond("live", BEGIN + 52 * S)
    assert limits.is_beyond("live", BEGIN + 53 * S)


def test_the_age_of_what_is_known_is_that_of_a_streams_newest_frame(bound) -> None:  # type: ignore[no-untyped-def]
    limits, time = bound
    known = {("file", "a"): BEGIN + 3 * S, ("file", "b"): BEGIN + 7 * S, ("live", "a"): BEGIN}
    assert limits.ages_s(known) == {}, "nobody has said yet what is now"
    limits.runs({"file": BEGIN + 10 * S, "live": BEGIN + 10 * S})
    assert limits.ages_s(known) == pytest.approx({"file": 3.0, "live": 10.0})
    time.now_s += 4.0
    assert limits.ages_s(known) == pytest.approx({"file": 7.0, "live": 14.0})
    assert limits.ages_s({}) == {}
