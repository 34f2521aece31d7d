"""Telemetry goes to the video that it fits: by length and date before name."""

from pathlib import Path

import numpy as np

from pipeline.ingest.track import Track
from pipeline.ingest.video.file import VideoInfo
from pipeline.init.pairing import pair
from pipeline.init.recordings import in_rows

NOON_NS = 1_700_000_000 * 10**9


def video(name: str, seconds: float) -> VideoInfo:
    return VideoInfo(Path("/card") / name, 1920, 1080, 30.0, round(30 * seconds), seconds, "h264")


def track(seconds: int, start_ns: int = 0, tied: bool = True) -> Track:
    column = np.ones(seconds)
    return Track(
        start_ns, np.arange(seconds, dtype=float), column, column, column, column, column, column, column,
        clock="local" if start_ns else "unknown", tied_to_video=tied, end_s=float(seconds),
    )  # fmt: skip


def pairs(
    videos: list[VideoInfo], tracks: dict[str, Track], began: list[int | None] | None = None
) -> list[str | None]:
    telemetry = {Path("/card") / name: t for name, t in tracks.items()}
    found = pair(videos, telemetry, began or [None] * len(videos))
    return [None if p.telemetry is None else p.telemetry.name for p in found]


def test_names_decide_where_nothing_says_better() -> None:
    videos = [video("a.mp4", 60), video("b.mp4", 60)]
    assert pairs(videos, {"b.srt": track(60), "a.srt": track(60)}) == ["a.srt", "b.srt"]


def test_lengths_decide_against_names_and_the_reason_is_given() -> None:
    videos = [video("a.mp4", 60), video("b.mp4", 90)]
    tracks = {Path("/card/a.srt"): track(90), Path("/card/b.srt"): track(60)}
    found = pair(videos, tracks, [None, None])
    assert [p.telemetry.name for p in found if p.telemetry] == ["b.srt", "a.srt"]
    assert "by length and date, not by name" in found[0].reason


def test_dates_decide_against_names_whatever_the_time_zone() -> None:
    videos = [video("a.mp4", 60), video("b.mp4", 60)]
    zone_ns = 2 * 3600 * 10**9
    tracks = {"a.srt": track(60, NOON_NS + zone_ns + 400 * 10**9), "b.srt": track(60, NOON_NS + zone_ns)}
    assert pairs(videos, tracks, [NOON_NS, NOON_NS + 400 * 10**9]) == ["b.srt", "a.srt"]


def test_a_video_without_fitting_telemetry_gets_none() -> None:
    assert pairs([video("a.mp4", 60), video("b.mp4", 300)], {"a.srt": track(60)}) == ["a.srt", None]
    assert pairs([video("a.mp4", 600)], {"x.srt": track(5)}) == [None]
    assert pairs([video("a.mp4", 600)], {}) == [None]


def test_telemetry_that_ended_early_stays_with_the_video_of_its_name() -> None:
    assert pairs([video("a.mp4", 60)], {"a.srt": track(40)}) == ["a.srt"]


def test_a_flight_log_may_hold_more_than_the_video_but_not_less() -> None:
    assert pairs([video("a.mp4", 60)], {"log.csv": track(1000, tied=False)}) == ["log.csv"]
    assert pairs([video("a.mp4", 60)], {"log.csv": track(20, tied=False)}) == [None]


def test_recordings_that_follow_one_another_are_one_stream() -> None:
    videos = [video("DJI_0001.MP4", 60), video("DJI_0002.MP4", 30), video("DJI_0004.MP4", 30)]
    began: list[int | None] = [NOON_NS, NOON_NS + 61 * 10**9, NOON_NS + 91 * 10**9]
    assert in_rows(videos, began) == [[0, 1], [2]]
    assert in_rows(videos, [NOON_NS, NOON_NS + 200 * 10**9, None]) == [[0], [1], [2]]


def test_a_videos_own_track_wins_over_a_file_that_fits_no_better() -> None:
    videos = [video("a.mp4", 60), video("b.mp4", 90)]
    own = {"a.mp4": track(60), "b.mp4": track(90)}
    assert pairs(videos, own | {"a.srt": track(60), "b.srt": track(90)}) == ["a.mp4", "b.mp4"]
    assert pairs(videos, own | {"other.srt": track(60)}) == ["a.mp4", "b.mp4"]
    # a track that was cut off, beside a whole file
    assert pairs(videos, own | {"a.mp4": track(20), "a.srt": track(60)}) == ["a.srt", "b.mp4"]
    # nor does a track go to another video, however well it fits
    assert pairs(videos, {"b.mp4": track(60)}) == [None, "b.mp4"]
