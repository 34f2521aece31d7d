"""Live streams in a mission file: what may be written, and who sees a password."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from pipeline.config.mission import load_mission
from pipeline.config.stream_url import StreamUrl
from pipeline.errors import InputError

Write = Callable[..., Path]


def _live(write: Write, video: object, more: dict[str, object] | None = None, beside: object = None) -> Path:
    """The mission with another video; more: of its stream, instead of its telemetry. beside: another stream's video."""
    path = write("mission")
    mission = yaml.safe_load(path.read_text(encoding="utf-8"))
    stream = mission["streams"][0]
    del stream["telemetry"]
    stream |= {"video": video} | (more or {})
    if beside is not None:
        mission["streams"].append(
            stream | {"id": "other", "video": beside, "telemetry": {"file": "other.srt"}}
        )
    path.write_text(yaml.safe_dump(mission), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "url",
    [
        "rtsp://10.0.0.7/live",
        "udp://239.1.1.1:5600",
        "udp://@:5600",
        "rtmp://h/app/k?listen=1",
        "srt://h:9000?mode=caller",
    ],
)
def test_a_video_may_be_a_url_and_brings_its_telemetry(write: Write, url: str) -> None:
    mission = load_mission(_live(write, url))
    stream = mission.streams[0]
    assert mission.is_live
    assert stream.url == StreamUrl(url)
    assert stream.telemetry.heard == stream.url
    assert stream.videos == ()
    assert str(stream.url) == url


@pytest.mark.parametrize("file", ["udp://0.0.0.0:14550", "flight.tlog"])
def test_its_telemetry_may_be_a_port_or_a_file_that_grows(write: Write, file: str, tmp_path: Path) -> None:
    told = load_mission(_live(write, "rtsp://h/live", {"telemetry": {"file": file}})).streams[0].telemetry
    assert (told.heard is None) == ("tlog" in file)
    assert told.heard is not None or told.file == tmp_path / "flight.tlog"


@pytest.mark.parametrize(
    ("url", "shown"),
    [
        ("rtsp://pilot:geheim@10.0.0.7:554/live", "rtsp://pilot:***@10.0.0.7:554/live"),
        ("rtsp://pilot:ge@heim@10.0.0.7/live", "rtsp://pilot:***@10.0.0.7/live"),
        ("rtsp://pilot:@10.0.0.7/live", "rtsp://pilot:***@10.0.0.7/live"),
        (
            "srt://10.0.0.7:9000?mode=caller&passphrase=geheim123456",
            "srt://10.0.0.7:9000?mode=caller&passphrase=***",
        ),
        ("rtmp://h/app/x?token=geheim&listen=1", "rtmp://h/app/x?token=***&listen=1"),
    ],
)
def test_a_password_is_shown_to_nobody(url: str, shown: str) -> None:
    assert str(StreamUrl(url)) == shown
    assert "heim" not in repr(StreamUrl(url))


@pytest.mark.parametrize(
    ("video", "more", "at", "words"),
    [
        ("http://h/live.m3u8", {}, "video", "http://"),
        ("rtsps://pilot:geheim@h/live", {}, "video", "rtsps://"),
        ("udp://10.0.0.7", {}, "video", "udp://HOST:PORT"),
        ("rtsp://", {}, "video", "rtsp://HOST"),
        ("rtsp://pilot:geheim@h:port/live", {}, "video", "cannot be read"),
        (["rtsp://h/live", "b.mp4"], {}, "video", "among several"),
        ("rtsp://h/live", {"telemetry": {"file": "rtsp://other/live"}}, "telemetry.file", "MAVLink"),
        ("rtsp://h/live", {"end": {"seconds": 5}}, "video", "a part of a live stream"),
        ("rtsp://h/live", {"live": {"stall": {"seconds": 3}}}, "live.stall", "at most 2 s"),
        ("rtsp://h/live", {"live": {"reconnect": {"seconds": 1}}}, "live.reconnect", "at least the stall"),
        ("a.mp4", {"telemetry": {"file": "a.srt"}, "live": {"wait": {"seconds": 3}}}, "live", "beside"),
        ("a.mp4", {"telemetry": {"file": "udp://0.0.0.0:14550"}}, "telemetry.file", "a file"),
    ],
)
def test_what_cannot_be_is_one_line_without_the_password(
    write: Write, video: object, more: dict[str, object], at: str, words: str
) -> None:
    with pytest.raises(InputError) as caught:
        load_mission(_live(write, video, more))
    assert at in caught.value.where
    assert words in f"{caught.value.found} {caught.value.expected}"
    assert "geheim" not in str(caught.value)
    assert "\n" not in str(caught.value)


def test_recordings_are_of_another_time_than_live_streams(write: Write) -> None:
    with pytest.raises(InputError, match="live streams only, or recordings only"):
        load_mission(_live(write, "rtsp://h/live", beside="b.mp4"))
