"""Videos are read whole, or refused with the reason."""

from pathlib import Path

import av
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.ingest.video.file import check_video, open_video, read_frames, sampled_indices

SIZE, FRAMES, RATE = (96, 64), 30, 10


def gray(index: int) -> int:
    return 20 + 7 * index


def write_video(path: Path, options: dict[str, str] | None = None, codec: str = "libx264") -> Path:
    """Pictures of one gray each, so that a picture tells its number; with B-frames, so that order matters."""
    noise = np.random.default_rng(0).integers(-8, 9, (SIZE[1], SIZE[0], 1))
    with av.open(str(path), "w", options=options or {}) as container:
        stream = container.add_stream(codec, rate=RATE, options={"bf": "2", "g": "10"})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for index in range(FRAMES):
            image = np.repeat(np.clip(gray(index) + noise, 0, 255), 3, axis=2).astype(np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))
    return path


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_video(tmp_path_factory.mktemp("video") / "flight.mp4")


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv", "avi", "ts"])
def test_the_container_tells_what_was_written(tmp_path: Path, suffix: str) -> None:
    info = check_video(write_video(tmp_path / f"flight.{suffix}"), thorough=True)
    assert (info.width, info.height, info.frames, info.codec) == (*SIZE, FRAMES, "h264")
    assert info.frame_rate == pytest.approx(RATE)
    assert info.duration_s == pytest.approx(FRAMES / RATE)


def test_all_pictures_come_in_order_with_their_time(video: Path) -> None:
    read = list(read_frames(video))
    assert [index for index, _, _ in read] == list(range(FRAMES))
    assert [time_s for _, time_s, _ in read] == pytest.approx([i / RATE for i in range(FRAMES)])
    for index, _, image in read:
        assert image.shape == (SIZE[1], SIZE[0], 3)
        assert image.dtype == np.uint8
        assert image.mean() == pytest.approx(gray(index), abs=2.0)


@pytest.mark.parametrize(
    "wanted", [frozenset({3, 7, 29}), [29, 3, 7], np.array([3, 7, 29]), {3, 7, 29}.__contains__]
)
def test_only_wanted_pictures_come_and_they_are_the_right_ones(video: Path, wanted: object) -> None:
    read = list(read_frames(video, wanted))  # type: ignore[arg-type]
    assert [index for index, _, _ in read] == [3, 7, 29]
    assert [image.mean() for _, _, image in read] == pytest.approx([gray(i) for i in (3, 7, 29)], abs=2.0)


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


def test_an_mp4_cut_before_its_index_is_refused(tmp_path: Path, video: Path) -> None:
    path = tmp_path / "cut.mp4"
    path.write_bytes(video.read_bytes()[: video.stat().st_size // 2])
    with pytest.raises(InputError, match="cannot be opened"):
        open_video(path)


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_a_video_cut_after_its_index_is_refused_without_decoding(tmp_path: Path, suffix: str) -> None:
    whole = write_video(tmp_path / f"whole.{suffix}", {"movflags": "faststart"} if suffix == "mp4" else None)
    cut = tmp_path / f"cut.{suffix}"
    cut.write_bytes(whole.read_bytes()[: int(whole.stat().st_size * 0.6)])
    with pytest.raises(InputError, match=r"whole pictures of 30 promised"):
        check_video(cut)


def test_the_last_packet_cut_short_is_noticed_without_decoding(tmp_path: Path) -> None:
    whole = write_video(tmp_path / "whole.mp4", {"movflags": "faststart"})
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(whole.read_bytes()[:-5])
    with pytest.raises(InputError, match="found 29 whole pictures of 30 promised"):
        check_video(cut)


def test_damage_in_the_middle_names_the_picture(tmp_path: Path, video: Path) -> None:
    with av.open(str(video)) as container:
        packets = [packet for packet in container.demux(video=0) if packet.size]
        target = max((p for p in packets if not p.is_keyframe), key=lambda p: p.size)
        start, size = target.pos, target.size
    damaged = tmp_path / "damaged.mp4"
    data = bytearray(video.read_bytes())
    data[start : start + size] = bytes(0xFF for _ in range(size))
    damaged.write_bytes(data)
    check_video(damaged)
    with pytest.raises(InputError, match=r"damaged\.mp4 frame \d+: found a damaged picture"):
        check_video(damaged, thorough=True)


def test_processing_faster_than_the_video_is_refused() -> None:
    with pytest.raises(InputError, match="found 31 Hz; expected at most the video's 30 Hz"):
        sampled_indices(100, 30.0, 31.0)


def test_a_real_recording_is_whole() -> None:
    path = Path(__file__).parents[4] / "shared/data/video/one-by-one-person-detection.mp4"
    if not path.exists():
        pytest.skip("no shared data beside the repository")
    info = check_video(path)
    assert (info.width, info.height, info.frames, info.frame_rate) == (768, 432, 1394, 10.0)
