"""A log with its own clock meets its video by what both say, or by the mission, and never by chance."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.config.telemetry import Angles, Telemetry
from pipeline.errors import InputError
from pipeline.ingest.clock import Alignment, align, on_the_videos_clock, recordings_s
from pipeline.ingest.track import Track

START_NS = 1_700_000_000 * 10**9


def log(seconds: int = 100, **fields: object) -> Track:
    n = seconds + 1
    column = np.full(n, 1.0)
    track = Track(START_NS, 5.0 + np.arange(n), column, column, column, column, column, column, column)
    return replace(track, tied_to_video=False, **fields)  # type: ignore[arg-type]


def offset_s(track: Track, video_s: float, created_ns: int | None = None, **given: object) -> float:
    telemetry = Telemetry.model_validate({"file": "log.csv", **given})
    return align(track, telemetry, video_s, created_ns, "log.csv").offset_s


def recording(*spans: tuple[int, int], seconds: int = 100) -> Track:
    flags = np.zeros(seconds + 1)
    for first, last in spans:
        flags[first : last + 1] = 1.0
    return log(seconds, recording=flags)


def test_the_missions_offset_comes_before_everything() -> None:
    assert offset_s(recording((10, 40)), 30.0, time_offset={"seconds": -3}) == -3.0


def test_subtitles_are_on_the_videos_clock() -> None:
    assert offset_s(replace(log(), tied_to_video=True), 7.0) == 0.0


def test_the_recording_that_is_as_long_as_the_video_is_the_videos() -> None:
    assert offset_s(recording((10, 40), (60, 70)), 30.0) == -15.0
    assert offset_s(recording((10, 40), (60, 70)), 10.4) == -65.0


def test_of_two_recordings_that_fit_the_date_decides_or_the_user_is_asked() -> None:
    twice = recording((10, 30), (60, 80))
    with pytest.raises(
        InputError, match=r"2 recordings in the log that fit.*expected telemetry\.time_offset"
    ):
        offset_s(twice, 20.0)
    assert offset_s(twice, 20.0, START_NS + 61 * 10**9) == -65.0


def test_without_recordings_the_dates_decide() -> None:
    assert offset_s(log(), 20.0, START_NS + 30 * 10**9) == -35.0
    assert (
        offset_s(log(clock="local"), 20.0, START_NS + 30 * 10**9 - 7_200 * 10**9, utc_offset={"hours": 2})
        == -35.0
    )
    with pytest.raises(InputError, match=r"telemetry\.utc_offset or"):
        offset_s(log(clock="local"), 20.0, START_NS)


def test_a_log_that_lasts_as_long_as_its_video_began_with_it() -> None:
    assert offset_s(log(100), 100.2) == -5.0
    with pytest.raises(InputError, match="a log with its own clock, of 100 s beside a video of 90 s"):
        offset_s(log(100), 90.0)


def test_recordings_are_the_runs_of_the_flag() -> None:
    assert recordings_s(recording((0, 3), (98, 100))) == [(5.0, 3.0), (103.0, 2.0)]
    assert recordings_s(log()) == []


def test_angles_of_another_file_meet_the_positions_by_the_dates_of_both() -> None:
    """The angles' log began 20 s after the positions' one, whose time 5 s is the video's 2 s."""
    angles = replace(log(), start_time_ns=START_NS + 20 * 10**9, times_s=700.0 + np.arange(101))
    stated = Angles.model_validate({"file": "gimbal.csv"})
    shifted = on_the_videos_clock(angles, stated, log(), Alignment(-3.0))
    assert (shifted.times_s[0], shifted.times_s[-1]) == (22.0, 122.0)


def test_angles_without_a_date_are_asked_about() -> None:
    stated = Angles.model_validate({"file": "gimbal.csv"})
    for clock in ("unknown", "local"):
        with pytest.raises(InputError, match=f"angles whose clock is {clock}.*angles.time_offset"):
            on_the_videos_clock(replace(log(), clock=clock), stated, log(), Alignment(0.0))  # type: ignore[arg-type]
