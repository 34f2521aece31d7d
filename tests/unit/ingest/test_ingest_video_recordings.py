"""Pictures come on one clock, upright, each once; what is damaged costs itself only."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.ingest.source import LostPicture, PassedPicture, Picture
from pipeline.ingest.video.recordings import Recordings, open_recordings
from tests.videos import SIZE, busy, gray, packet_places, plain, write_video

SHARED = Path(__file__).parents[4] / "shared/data"


def read(source: Recordings, rate_hz: float = 10.0) -> list[Picture | LostPicture | PassedPicture]:
    return list(source.pictures(rate_hz))


def given(source: Recordings, rate_hz: float = 10.0) -> list[Picture]:
    return [p for p in read(source, rate_hz) if isinstance(p, Picture)]


def shade(picture: Picture) -> float:
    return float(picture.image.mean())


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv", "avi", "ts"])
def test_all_pictures_come_in_order_with_their_time_and_tick(tmp_path: Path, suffix: str) -> None:
    pictures = given(open_recordings([write_video(tmp_path / f"flight.{suffix}")]))
    assert [p.index for p in pictures] == [p.tick for p in pictures] == list(range(30))
    assert [p.time_s for p in pictures] == pytest.approx([i / 10 for i in range(30)])
    assert [shade(p) for p in pictures] == pytest.approx([gray(i) for i in range(30)], abs=3.0)
    assert pictures[0].image.shape == (SIZE[1], SIZE[0], 3)


def test_every_picture_is_accounted_for_at_a_lower_rate(tmp_path: Path) -> None:
    source = open_recordings([write_video(tmp_path / "flight.mp4", rate=30)])
    pictures = read(source, 10.0)
    assert [p.index for p in pictures] == list(range(30))
    assert [p.index for p in pictures if isinstance(p, Picture)] == list(range(0, 30, 3))


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "ts"])
def test_a_late_start_is_no_time_of_the_video(tmp_path: Path, suffix: str) -> None:
    times = [7 + Fraction(i, 10) for i in range(30)]
    source = open_recordings([write_video(tmp_path / f"late.{suffix}", times=times)])
    pictures = given(source)
    assert [p.time_s for p in pictures] == pytest.approx([i / 10 for i in range(30)])
    assert source.info.duration_s == pytest.approx(3.0)


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "ts"])
def test_in_a_gap_nothing_is_taken_twice(tmp_path: Path, suffix: str) -> None:
    times = [Fraction(i, 30) for i in (*range(30), *range(60, 90))]
    source = open_recordings([write_video(tmp_path / f"gap.{suffix}", rate=30, times=times)])
    pictures = given(source, 10.0)
    # 29 is the last one before the gap, and so that at or just before the tick of 1 s
    assert [p.index for p in pictures] == [*range(0, 30, 3), 29, *range(30, 60, 3)]
    assert [p.tick for p in pictures] == [*range(11), *range(20, 30)]
    assert [p.time_s for p in pictures] == pytest.approx([float(times[p.index]) for p in pictures], abs=1e-3)
    assert len(read(source)) == 60


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_a_variable_rate_is_sampled_by_time(tmp_path: Path, suffix: str) -> None:
    times = [*(Fraction(i, 30) for i in range(30)), *(1 + Fraction(i, 5) for i in range(10))]
    path = write_video(tmp_path / f"vfr.{suffix}", rate=30, times=times, options={"bf": "0", "g": "10"})
    source = open_recordings([path])
    pictures = given(source, 10.0)
    assert [p.index for p in pictures] == [*range(0, 30, 3), *range(30, 40)]
    assert [p.tick for p in pictures] == [*range(10), *range(10, 30, 2)]
    assert not source.info.constant


def test_an_edit_list_hides_its_pictures(tmp_path: Path) -> None:
    whole = write_video(tmp_path / "whole.mp4")
    cut = tmp_path / "edited.mp4"
    with av.open(str(whole)) as old, av.open(str(cut), "w") as new:
        stream = new.add_stream_from_template(old.streams.video[0])
        for packet in old.demux(video=0):
            if packet.size:
                # the muxer writes an edit list that begins at 0: what lies before it is not shown
                shift = round(Fraction(5, 10) / packet.time_base)
                packet.pts, packet.dts = packet.pts - shift, packet.dts - shift
                packet.stream = stream
                new.mux(packet)
    pictures = given(open_recordings([cut]))
    assert [shade(p) for p in pictures] == pytest.approx([gray(i) for i in range(5, 30)], abs=3.0)
    assert [p.time_s for p in pictures] == pytest.approx([i / 10 for i in range(25)])
    assert [p.index for p in pictures] == list(range(25))


def test_the_counter_of_a_transport_stream_may_wrap(tmp_path: Path) -> None:
    start = Fraction(2**33, 90_000) - Fraction(3, 2)
    times = [start + Fraction(i, 10) for i in range(30)]
    path = write_video(tmp_path / "wrap.ts", times=times, container_options={"mpegts_copyts": "1"})
    pictures = given(open_recordings([path]))
    assert [p.time_s for p in pictures] == pytest.approx([i / 10 for i in range(30)], abs=1e-3)


def test_a_transport_stream_whose_clock_begins_anew_goes_on(tmp_path: Path) -> None:
    one, two = (
        write_video(tmp_path / f"{k}.ts", times=[k + Fraction(i, 10) for i in range(30)]) for k in (100, 5)
    )
    joined = tmp_path / "joined.ts"
    joined.write_bytes(one.read_bytes() + two.read_bytes())
    pictures = given(open_recordings([joined]))
    assert len(pictures) == 60
    assert np.diff([p.time_s for p in pictures]) == pytest.approx(0.1, abs=0.05)


@pytest.mark.parametrize(
    ("rotation", "top"), [(0, "red"), (90, "right"), (180, "bottom"), (270, "left"), (-90, "left")]
)
def test_pictures_are_upright(tmp_path: Path, rotation: int, top: str) -> None:
    def marked(index: int, size: tuple[int, int]) -> np.ndarray:  # type: ignore[type-arg]
        image = plain(index, size)
        image[:16] = [200, 30, 30]
        return image

    path = write_video(tmp_path / "turned.mp4", count=3, rotation=rotation, picture=marked)
    source = open_recordings([path])
    image = given(source)[0].image.astype(int)
    wide = rotation % 180 == 0
    assert (source.info.width, source.info.height) == (SIZE if wide else SIZE[::-1])
    assert image.shape[:2] == (source.info.height, source.info.width)
    # set_display_rotation turns counterclockwise: what was on top comes to the left with 90 degrees
    edge = {0: image[:10], 90: image[:, :10], 180: image[-10:], 270: image[:, -10:]}[rotation % 360]
    assert (edge[..., 0] - edge[..., 1]).mean() > 80
    assert (image[..., 0] - image[..., 1]).mean() < 80
    ((_, full),) = source.images_at([0.0])
    assert np.abs(full.astype(int) - image).mean() < 6.0


def test_pixels_are_made_square(tmp_path: Path) -> None:
    source = open_recordings([write_video(tmp_path / "wide.mp4", count=3, aspect=Fraction(4, 3))])
    assert (source.info.width, source.info.height) == (128, 64)
    assert given(source)[0].image.shape == (64, 128, 3)
    assert any("made square" in f.found for f in source.findings)


def test_odd_sizes_are_sent_even_and_known_odd(tmp_path: Path) -> None:
    path = write_video(tmp_path / "odd.mp4", count=3, size=(97, 65), pix_fmt="yuv444p")
    source = open_recordings([path])
    assert (source.info.width, source.info.height, source.sent_size) == (97, 65, (96, 64))
    assert given(source)[0].image.shape == (64, 96, 3)
    ((_, full),) = source.images_at([0.0])
    assert full.shape == (65, 97, 3)


@pytest.mark.parametrize(
    ("codec", "pix_fmt", "suffix"),
    [
        ("libx264", "yuv420p10le", "mp4"),
        ("libx265", "yuv420p10le", "mp4"),
        ("libx264", "gray", "mp4"),
        ("libx264", "yuvj420p", "mp4"),
        ("libx264", "yuv422p", "ts"),
        ("ffv1", "gray16le", "mkv"),
        ("ffv1", "gray", "mkv"),
        ("mjpeg", "yuvj422p", "avi"),
        ("mpeg4", "yuv420p", "avi"),
        ("libvpx-vp9", "yuv420p", "mkv"),
    ],
)
def test_every_format_of_pixels_shows_the_same_gray(
    tmp_path: Path, codec: str, pix_fmt: str, suffix: str
) -> None:
    options = {"x265-params": "log-level=none"} if codec == "libx265" else {}
    path = write_video(
        tmp_path / f"pixels.{suffix}", count=6, codec=codec, pix_fmt=pix_fmt, options=options or {"g": "3"}
    )
    pictures = given(open_recordings([path]))
    assert [shade(p) for p in pictures] == pytest.approx([gray(i) for i in range(6)], abs=6.0)
    assert {p.planes.format.name for p in pictures} == {"yuv420p"}


def test_a_thermal_palette_shows_its_colours(tmp_path: Path) -> None:
    path = tmp_path / "palette.mov"
    palette = np.zeros((256, 4), np.uint8)
    palette[:, 0], palette[:, 1] = 255, np.arange(256)  # opaque, black to red
    with av.open(str(path), "w") as container:
        stream = container.add_stream("png", rate=10)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "pal8"
        for index in range(3):
            hot = np.full((SIZE[1], SIZE[0]), 60 * (index + 1), np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray((hot, palette), format="pal8")))
        container.mux(stream.encode(None))
    means = [p.image.mean(axis=(0, 1)) for p in given(open_recordings([path]))]
    assert np.array(means) == pytest.approx(np.array([[60, 0, 0], [120, 0, 0], [180, 0, 0]]), abs=6.0)


def test_files_in_a_row_are_one_stream(tmp_path: Path) -> None:
    paths = [write_video(tmp_path / f"part{k}.mp4", count=12) for k in range(3)]
    source = open_recordings(paths)
    pictures = given(source)
    assert [p.index for p in pictures] == [p.tick for p in pictures] == list(range(36))
    assert [p.time_s for p in pictures] == pytest.approx([i / 10 for i in range(36)])
    assert source.info.duration_s == pytest.approx(3.6)
    images = [image.mean() for _, image in source.images_at([pictures[3].time_s, pictures[20].time_s])]
    assert images == pytest.approx([gray(3), gray(8)], abs=3.0)


def test_the_gap_between_files_is_that_of_their_dates(tmp_path: Path) -> None:
    paths = [
        write_video(tmp_path / f"part{k}.mp4", metadata={"creation_time": date})
        for k, date in enumerate(("2026-05-01T10:00:00Z", "2026-05-01T10:00:10Z", "2026-05-01T10:00:13Z"))
    ]
    source = open_recordings(paths)
    assert [offset_s for _, offset_s in source.files] == pytest.approx([0.0, 10.0, 13.0])
    assert [f.cause for f in source.findings] == ["recordings", "recordings"]
    assert "7.0 s after the end" in source.findings[0].found


def test_a_change_of_size_between_files_is_refused(tmp_path: Path) -> None:
    paths = [
        write_video(tmp_path / "a.mp4", count=3),
        write_video(tmp_path / "b.mp4", count=3, size=(128, 64)),
    ]
    with pytest.raises(InputError, match=r"b\.mp4: found 128 x 64 pixels; expected 96 x 64"):
        open_recordings(paths)


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "ts"])
def test_start_and_end_cut_the_stream(tmp_path: Path, suffix: str) -> None:
    path = write_video(tmp_path / f"flight.{suffix}")
    source = open_recordings([path], start_s=1.45, end_s=2.5)
    pictures = given(source)
    assert [p.index for p in pictures] == list(range(15, 25))
    assert [p.time_s for p in pictures] == pytest.approx([i / 10 for i in range(15, 25)])
    assert [shade(p) for p in pictures] == pytest.approx([gray(i) for i in range(15, 25)], abs=3.0)
    assert (source.info.pictures, source.info.start_s, source.info.duration_s) == (10, 1.45, 2.5)
    with pytest.raises(InputError, match=r"found start 9 s and end 3 s"):
        open_recordings([path], start_s=9.0)


def test_a_file_that_is_cut_off_gives_all_that_is_in_it(tmp_path: Path) -> None:
    whole = write_video(tmp_path / "whole.mp4", container_options={"movflags": "faststart"}, picture=busy)
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(whole.read_bytes()[: int(whole.stat().st_size * 0.6)])
    pictures = read(open_recordings([cut]))
    lost = [p for p in pictures if isinstance(p, LostPicture)]
    assert sorted(p.index for p in pictures) == list(range(30))
    assert 10 <= sum(isinstance(p, Picture) for p in pictures) <= 18
    assert {p.reason for p in lost} <= {"damaged", "missing"}
    assert sum(p.reason == "missing" for p in lost) >= 10


@pytest.mark.parametrize("suffix", ["mp4", "mkv", "ts"])
def test_a_damaged_picture_costs_itself(tmp_path: Path, suffix: str) -> None:
    whole = write_video(tmp_path / f"whole.{suffix}", picture=busy, options={"bf": "0", "g": "10"})
    start, size, _ = packet_places(whole)[14]
    data = bytearray(whole.read_bytes())
    for k in range(start + size // 4, start + size // 2):
        data[k] ^= 0x5A
    damaged = tmp_path / f"damaged.{suffix}"
    damaged.write_bytes(data)
    pictures = read(open_recordings([damaged]))
    lost = [p for p in pictures if isinstance(p, LostPicture)]
    assert {p.reason for p in lost} == {"damaged"}
    assert 14 in {p.index for p in lost}
    assert sum(isinstance(p, Picture) for p in pictures) >= 24
    assert [p.index for p in pictures] == sorted({p.index for p in pictures})


def test_the_picture_before_a_damaged_one_takes_its_tick(tmp_path: Path) -> None:
    whole = write_video(
        tmp_path / "w.mp4", rate=30, picture=busy, options={"bf": "0", "g": "30", "crf": "10"}
    )
    start, size, _ = packet_places(whole)[15]
    data = bytearray(whole.read_bytes())
    data[start : start + size] = bytes(0xFF for _ in range(size))
    damaged = tmp_path / "d.mp4"
    damaged.write_bytes(data)
    pictures = read(open_recordings([damaged]), 10.0)
    assert [(p.index, p.tick) for p in pictures if isinstance(p, Picture)][4:7] == [(12, 4), (14, 5), (18, 6)]
    # a decoder may also give up the next one, which is built on it
    assert [p.index for p in pictures if isinstance(p, LostPicture)] in ([15], [15, 16])
    assert len(pictures) == 30


def test_decoding_with_several_threads_gives_the_same_pictures(tmp_path: Path) -> None:
    path = write_video(tmp_path / "flight.mp4", picture=busy)
    one, four = (given(open_recordings([path], threads=n)) for n in (1, 4))
    assert all(np.array_equal(a.image, b.image) for a, b in zip(one, four, strict=True))


def test_a_smaller_size_is_the_mean_of_the_pixels(tmp_path: Path) -> None:
    path = write_video(tmp_path / "flight.mp4", count=3, size=(192, 128), picture=busy, options={"crf": "5"})
    source = open_recordings([path])
    small = given(source.resized(96, 64))[0].planes.to_ndarray()[:64].astype(float)
    whole = given(source)[0].planes.to_ndarray()[:128].astype(float)
    assert small.shape == (64, 96)
    assert np.abs(small - whole.reshape(64, 2, 96, 2).mean(axis=(1, 3))).mean() < 1.5


def test_a_wanted_picture_that_is_damaged_is_left_out(tmp_path: Path) -> None:
    whole = write_video(tmp_path / "w.mp4", picture=busy, options={"bf": "0", "g": "10"})
    start, size, _ = packet_places(whole)[14]
    data = bytearray(whole.read_bytes())
    data[start : start + size] = bytes(0xFF for _ in range(size))
    (tmp_path / "d.mp4").write_bytes(data)
    source = open_recordings([tmp_path / "d.mp4"])
    assert [t for t, _ in source.images_at([1.4, 2.5, 0.3])] == [0.3, 2.5]


def test_planes_at_a_time_are_those_that_the_run_sends(tmp_path: Path) -> None:
    source = open_recordings([write_video(tmp_path / "flight.mp4")]).resized(48, 32)
    sent = {p.time_s: p.planes.to_ndarray() for p in given(source)}
    times_s = sorted(sent)[3:9:2]
    found = dict(source.planes_at(times_s))
    assert list(found) == times_s
    for time_s in times_s:
        np.testing.assert_array_equal(found[time_s].to_ndarray(), sent[time_s])
