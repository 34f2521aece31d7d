"""Pictures that nobody needs are not decoded, and those that are needed are the same as if they were."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest

from pipeline.ingest.source import LostPicture, PassedPicture, Picture
from pipeline.ingest.video import decode
from pipeline.ingest.video.recordings import open_recordings
from tests.videos import busy, packet_places, write_video

Told = list[tuple[str, int, float, int, bytes]]


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many packets went to the decoder."""
    count = [0]
    inner = decode._decoded

    def counting(stream: object, packet: object) -> object:
        count[0] += packet is not None
        return inner(stream, packet)  # type: ignore[arg-type]

    monkeypatch.setattr(decode, "_decoded", counting)
    return count


def told(paths: list[Path], rate_hz: float, threads: int = 1, start_s: float | None = None) -> Told:
    """Kind, number, time, tick and pixels of every picture."""
    return [
        (
            type(p).__name__,
            p.index,
            round(p.time_s, 6),
            p.tick if isinstance(p, Picture) else -1,
            p.image.tobytes() if isinstance(p, Picture) else b"",
        )
        for p in open_recordings(paths, start_s, None, threads).pictures(rate_hz)
    ]


def with_all_decoded(
    monkeypatch: pytest.MonkeyPatch, paths: list[Path], rate_hz: float, start_s: float | None
) -> Told:
    with monkeypatch.context() as patch:
        patch.setattr(decode, "without_unneeded", lambda packets, needed: packets)
        return told(paths, rate_hz, 1, start_s)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("rate_hz", [10.0, 4.0, 1.0, 0.5])
@pytest.mark.parametrize("start_s", [None, 0.7])
@pytest.mark.parametrize(
    ("suffix", "codec", "options"),
    [
        ("mp4", "libx264", {"bf": "0", "g": "10"}),
        ("mkv", "libx264", {"bf": "0", "g": "7"}),
        ("ts", "libx264", {"bf": "0", "g": "12"}),
        ("mp4", "libx264", {"bf": "2", "g": "10"}),
        ("mp4", "libx264", {"bf": "0", "g": "8", "x264-params": "open-gop=1"}),
        ("mp4", "libx265", {"x265-params": "log-level=none:keyint=9:bframes=0"}),
        ("mkv", "libx265", {"x265-params": "log-level=none:keyint=9:bframes=3:open-gop=1"}),
        ("avi", "mpeg4", {"bf": "0", "g": "10"}),
        ("mp4", "mjpeg", {"qmin": "2"}),
    ],
)
def test_the_pictures_are_those_of_a_reader_that_decodes_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str, codec: str, options: dict[str, str],
    rate_hz: float, start_s: float | None, threads: int,
) -> None:  # fmt: skip
    pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
    path = write_video(
        tmp_path / f"v.{suffix}", 75, 30, codec=codec, options=options, picture=busy, pix_fmt=pix_fmt
    )
    ours = told([path], rate_hz, threads, start_s)
    assert ours == with_all_decoded(monkeypatch, [path], rate_hz, start_s)
    assert any(kind == "Picture" for kind, *_ in ours)


def test_several_files_in_a_row_stay_one_stream(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = [write_video(tmp_path / f"{k}.mp4", 40, 30, options={"bf": "0", "g": "10"}) for k in range(2)]
    assert told(paths, 4.0) == with_all_decoded(monkeypatch, paths, 4.0, None)


@pytest.mark.parametrize(("rate_hz", "expected"), [(10.0, 91), (5.0, 73), (1.0, 13), (30.0, 100)])
def test_what_follows_the_last_one_needed_is_not_decoded(
    tmp_path: Path, decoded: list[int], rate_hz: float, expected: int
) -> None:
    """Ten pictures from one that stands alone to the next; those at the end of the file are all decoded."""
    path = write_video(tmp_path / "v.mp4", 100, 30, options={"bf": "0", "g": "10"})
    source = open_recordings([path])
    decoded[0] = 0
    assert len(list(source.pictures(rate_hz))) == 100
    assert decoded[0] == expected


def test_pictures_out_of_order_are_all_decoded(tmp_path: Path, decoded: list[int]) -> None:
    path = write_video(tmp_path / "v.mp4", 60, 30, options={"bf": "2", "g": "10"})
    source = open_recordings([path])
    decoded[0] = 0
    assert len(list(source.pictures(1.0))) == 60
    assert decoded[0] == 60


@pytest.mark.parametrize("number", [20, 21, 29, 30])
def test_damage_costs_its_picture_and_those_that_refer_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    path = write_video(tmp_path / "v.mp4", 60, 30, options={"bf": "0", "g": "10"}, picture=busy)
    data = bytearray(path.read_bytes())
    place, size, _ = packet_places(path)[number]
    data[place + 4 : place + size] = bytes(size - 4)
    path.write_bytes(data)
    ours, all_of_them = told([path], 10.0), with_all_decoded(monkeypatch, [path], 10.0, None)
    assert [one[1] for one in ours] == [one[1] for one in all_of_them] == list(range(60))
    right = {one[1]: one for one in all_of_them if one[0] == "Picture"}
    for one in ours:
        if one[0] == "Picture":
            assert one == right[one[1]]
    taken = {one[1] for one in ours if one[0] == "Picture"}
    # a picture that stands alone and is damaged: the one before it, which would stand in, was not decoded
    assert set(right) - taken <= {number - 1}
    assert sum(one[0] == "Picture" for one in ours) >= 16


def test_no_traceback_is_left_in_a_file_without_pictures_that_stand_alone(tmp_path: Path) -> None:
    path = write_video(tmp_path / "v.mkv", 40, 30, options={"bf": "0", "g": "600"})
    kinds = [type(p) for p in open_recordings([path]).pictures(10.0)]
    assert kinds.count(Picture) + kinds.count(PassedPicture) == 40
    assert LostPicture not in kinds
    with av.open(str(path)) as container:
        assert sum(p.is_keyframe for p in container.demux(video=0) if p.size) == 1
    assert np.isfinite(open_recordings([path]).end_s)
