"""Streams of one mission are put on one clock, and what was assumed for that is said."""

import numpy as np
import pytest

from pipeline.ingest.track import Clock
from pipeline.ingest.trajectory import Trajectory
from pipeline.mission.clocks import pacing_offsets_s, settled

HOUR_NS = 3_600 * 10**9


def stream(start_ns: int, clock: Clock = "local") -> Trajectory:
    one = np.ones(1)
    return Trajectory(one, np.ones((1, 3)), np.ones((1, 3)), np.ones((1, 3)), one, 60.0, 3.0, start_ns, clock)


def starts(*streams: Trajectory) -> tuple[list[int], list[str]]:
    moved, findings = settled([(f"drone-{k}", s, 60.0) for k, s in enumerate(streams)])
    return [s.start_ns for s in moved], [f.cause for f in findings]


@pytest.mark.parametrize("hours", [1.0, -2.0, 5.5, 0.25])
def test_a_clock_of_another_zone_is_moved_and_said(hours: float) -> None:
    ahead = round(hours * HOUR_NS)
    assert starts(stream(HOUR_NS * 9), stream(HOUR_NS * 9 + ahead + 10**9)) == (
        [HOUR_NS * 9, HOUR_NS * 9 + 10**9],
        ["time_zone"],
    )


@pytest.mark.parametrize("ahead_ns", [0, 30 * 10**9, -20 * 10**9])
def test_clocks_that_overlap_are_left(ahead_ns: int) -> None:
    assert starts(stream(HOUR_NS), stream(HOUR_NS + ahead_ns)) == ([HOUR_NS, HOUR_NS + ahead_ns], [])


@pytest.mark.parametrize(
    ("ahead_s", "severity", "words"),
    [
        (400.0, "assumed", "begins 6.7 min after"),
        (-90.0, "assumed", "begins 90.0 s before"),
        (7 * 3600.0 + 400.0, "assumed", "begins 7.1 h after"),
        (48 * 3600.0, "warning", "begins 2.0 days after"),
        (-11.5 * 365 * 86400.0, "warning", "was its clock set?"),
    ],
)
def test_flights_apart_by_no_zone_are_left_and_said_with_what_would_mend_them(
    ahead_s: float, severity: str, words: str
) -> None:
    first, second = stream(0), stream(round(ahead_s * 1e9))
    moved, findings = settled([("one", first, 60.0), ("two", second, 60.0)])
    assert [t.start_ns for t in moved] == [first.start_ns, second.start_ns]
    (finding,) = findings
    assert (finding.severity, finding.cause, finding.where) == (severity, "time_apart", "two")
    assert words in finding.found
    assert f"utc_offset {ahead_s:+.0f} s" in finding.mend


def test_clocks_that_are_known_to_be_utc_are_left_but_an_hour_apart_is_said() -> None:
    assert starts(stream(0, "utc"), stream(HOUR_NS, "utc")) == ([0, HOUR_NS], ["time_zone"])
    assert starts(stream(0, "utc"), stream(400 * 10**9, "utc")) == ([0, 400 * 10**9], ["time_apart"])


def test_a_stream_without_dates_begins_with_the_first_that_has_them() -> None:
    assert starts(stream(0, "unknown"), stream(HOUR_NS)) == ([HOUR_NS, HOUR_NS], ["clock_unknown"])
    assert starts(stream(0, "unknown"), stream(0, "unknown")) == ([0, 0], ["clock_unknown"] * 2)


def test_at_pace_realtime_nobody_waits_for_a_flight_that_was_an_hour_later() -> None:
    assert pacing_offsets_s(
        [0, 3 * 10**9, HOUR_NS, HOUR_NS + 5 * 10**9], [60.0, 60.0, 60.0, 60.0]
    ) == pytest.approx([0.0, 3.0, 73.0, 78.0])
    assert pacing_offsets_s([HOUR_NS, 0], [10.0, 10.0]) == [20.0, 0.0]
