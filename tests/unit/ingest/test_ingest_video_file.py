"""A video file is probed by its index and a few pictures: what it holds, or why it cannot be used."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.ingest.video.file import decoded_frames, open_video, probe_video
from tests.videos import SIZE, gray, packet_places, write_video

FRAMES, RATE = 30, 10
SHARED = Path(__file__).parents[4] / "shared/data"


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_video(tmp_path_factory.mktemp("video") / "flight.mp4")


def causes(path: Path) -> list[str]:
    return [finding.cause for finding in probe_video(path).findings]


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv", "avi", "ts"])
def test_the_container_tells_what_was_written(tmp_path: Path, suffix: str) -> None:
    file = probe_video(write_video(tmp_path / f"flight.{suffix}"))
    info = file.info
    assert (info.width, info.height, info.frames, info.codec) == (*SIZE, FRAMES, "h264")
    assert info.frame_rate == pytest.approx(RATE)
    assert info.duration_s == pytest.approx(FRAMES / RATE)
    assert file.constant
    assert file.findings == ()


def test_a_missing_an_empty_and_a_text_file_are_refused(tmp_path: Path) -> None:
    empty, text = tmp_path / "empty.mp4", tmp_path / "text.mp4"
    empty.touch()
    text.write_text("1\n00:00:00,000 --> 00:00:01,000\nno video\n")
    for path, found in [
        (tmp_path / "no.mp4", "no file"),
        (empty, "an empty file"),
        (text, "cannot be opened"),
    ]:
        with pytest.raises(InputError, match=found):
            open_video(path)


def test_a_playlist_is_refused_whatever_its_name(tmp_path: Path, video: Path) -> None:
    playlist = tmp_path / "flight.mp4"
    playlist.write_text(f"#EXTM3U\n#EXT-X-TARGETDURATION:3\n#EXTINF:3,\n{video}\n#EXT-X-ENDLIST\n")
    with pytest.raises(InputError, match="cannot be opened"):
        open_video(playlist)


def test_a_file_without_a_picture_track_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "sound.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=48000, layout="mono")
        sound = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        sound.rate = 48000
        container.mux(stream.encode(sound))
        container.mux(stream.encode(None))
    with pytest.raises(InputError, match="no video in the file"):
        open_video(path)


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "ts"])
def test_a_video_of_no_length_is_refused(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(InputError, match=r"without a picture|cannot be opened|no video|an empty file"):
        open_video(write_video(tmp_path / f"flight.{suffix}", count=0))


def test_an_mp4_cut_before_its_index_is_refused(tmp_path: Path, video: Path) -> None:
    path = tmp_path / "cut.mp4"
    path.write_bytes(video.read_bytes()[: video.stat().st_size // 2])
    with pytest.raises(InputError, match="cannot be opened"):
        open_video(path)


def test_an_mp4_cut_after_its_index_says_how_many_pictures_are_missing(tmp_path: Path) -> None:
    whole = write_video(tmp_path / "whole.mp4", container_options={"movflags": "faststart"})
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(whole.read_bytes()[:-5])
    (finding,) = probe_video(cut).findings
    assert (finding.severity, finding.cause) == ("warning", "missing")
    assert "29 whole pictures of 30 promised" in finding.found


def test_a_matroska_without_its_end_is_used_as_far_as_it_goes(tmp_path: Path) -> None:
    whole = write_video(tmp_path / "whole.mkv")
    cut = tmp_path / "cut.mkv"
    cut.write_bytes(whole.read_bytes()[: int(whole.stat().st_size * 0.6)])
    assert 5 < probe_video(cut).info.frames < FRAMES


def test_a_file_whose_pictures_are_all_damaged_is_refused(tmp_path: Path, video: Path) -> None:
    data = bytearray(video.read_bytes())
    for start, size, _ in packet_places(video):
        data[start : start + size] = bytes(0xFF for _ in range(size))
    damaged = tmp_path / "damaged.mp4"
    damaged.write_bytes(data)
    with pytest.raises(InputError, match="no picture that can be decoded"):
        open_video(damaged)


def test_strict_decoding_names_the_first_damaged_picture(tmp_path: Path, video: Path) -> None:
    start, size, _ = max((p for p in packet_places(video) if not p[2]), key=lambda p: p[1])
    data = bytearray(video.read_bytes())
    data[start : start + size] = bytes(0xFF for _ in range(size))
    damaged = tmp_path / "damaged.mp4"
    damaged.write_bytes(data)
    open_video(damaged)
    with pytest.raises(InputError, match=r"damaged\.mp4 frame \d+: found a damaged picture"):
        for _ in decoded_frames(damaged):
            pass
    assert len(list(decoded_frames(video))) == FRAMES


def test_a_title_in_another_encoding_does_not_matter(tmp_path: Path) -> None:
    path = write_video(tmp_path / "title.mkv", metadata={"title": "QQQQ"})
    path.write_bytes(path.read_bytes().replace(b"QQQQ", b"\xb4\xf3\xbd\xae"))
    assert open_video(path).frames == FRAMES


def test_of_two_video_tracks_it_is_said_which_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "two.mkv"
    with av.open(str(path), "w") as container:
        streams = []
        for size in ((96, 64), (192, 128)):
            stream = container.add_stream("libx264", rate=10)
            stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
            streams.append(stream)
        for index in range(5):
            for stream in streams:
                image = np.full((stream.height, stream.width, 3), gray(index), np.uint8)
                frame = av.VideoFrame.from_ndarray(image, format="rgb24")
                frame.pts, frame.time_base = index, Fraction(1, 10)
                container.mux(stream.encode(frame))
        for stream in streams:
            container.mux(stream.encode(None))
    file = probe_video(path)
    assert (file.info.width, file.info.height) == (192, 128)
    assert "2 video tracks (0: 96 x 64, 1: 192 x 128); track 1 is used" in file.findings[0].found


def test_a_gap_is_noticed_and_the_rate_is_that_of_the_rest(tmp_path: Path) -> None:
    times = [Fraction(i, 10) for i in (*range(10), *range(20, 30))]
    file = probe_video(write_video(tmp_path / "gap.ts", times=times))
    assert (file.info.frames, file.constant) == (20, False)
    assert file.info.frame_rate == pytest.approx(10.0)
    assert file.info.duration_s == pytest.approx(3.0)
    assert [f.cause for f in file.findings] == ["video_gap"]
    assert "1.00 s in all" in file.findings[0].found


def test_the_shared_cases_hold_what_is_known_of_them() -> None:
    if not SHARED.exists():
        pytest.skip("no shared data beside the repository")
    last_s = {
        name: probe_video(SHARED / "cases/video" / name).index.times_s[-1] for name in ("gap.ts", "vfr.mkv")
    }
    assert last_s == {"gap.ts": pytest.approx(2.967, abs=1e-3), "vfr.mkv": pytest.approx(3.3, abs=1e-3)}
    assert open_video(SHARED / "cases/video/non_utf8_title.mp4").frames == 5
    with pytest.raises(InputError, match="a video codec that is not known"):
        open_video(SHARED / "cases/video/unknowncodec.mp4")
    info = open_video(SHARED / "video/one-by-one-person-detection.mp4")
    assert (info.width, info.height, info.frames, info.frame_rate) == (768, 432, 1394, 10.0)
