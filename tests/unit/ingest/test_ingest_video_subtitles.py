"""Subtitles inside a video are those beside it; a video without any is refused with the way out."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.config.mission import Stream
from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.registry import format_of, read_telemetry
from pipeline.ingest.telemetry.dji_srt import read_dji_srt
from pipeline.ingest.track import Track
from tests.dialects import demo, dji_subtitles, video_text_track

VIDEO = demo.DEMO / "drone-1.mp4"
TEXTS = {
    "brackets": dji_subtitles.brackets,
    "G.PRY": dji_subtitles.pitch_roll_yaw,
    "RTK": dji_subtitles.rtk,
    "BAROMETER": dji_subtitles.barometer,
}


@pytest.fixture(scope="module")
def rows() -> Track:
    return demo.at_rate(demo.true_track("drone-1"), 5.0)


@pytest.mark.parametrize("suffix", [".mp4", ".MOV", ".mkv"])
@pytest.mark.parametrize("text", TEXTS)
def test_a_text_track_is_read_as_the_file_beside_the_video(
    tmp_path: Path, rows: Track, text: str, suffix: str
) -> None:
    inside, beside = tmp_path / f"drone{suffix}", tmp_path / "drone.srt"
    video_text_track.write(inside, VIDEO, rows, TEXTS[text])
    dji_subtitles.write(beside, rows, TEXTS[text])
    telemetry = Telemetry(file=inside)
    assert format_of(telemetry).name == "video-subtitles"
    track, other = read_telemetry(telemetry), read_dji_srt(beside)
    np.testing.assert_allclose(track.times_s, other.times_s, atol=0.0011)
    assert track.end_s == pytest.approx(other.end_s, abs=0.0011)
    for name in ("latitude_deg", "longitude_deg", "relative_height_m", "yaw_rad", "pitch_rad"):
        np.testing.assert_array_equal(getattr(track, name), getattr(other, name))
    assert (track.clock, track.start_time_ns, track.left_out) == (other.clock, other.start_time_ns, {})


def test_a_bad_cue_inside_a_video_costs_itself_and_is_named(tmp_path: Path, rows: Track) -> None:
    path = tmp_path / "drone.mp4"
    video_text_track.write(
        path,
        VIDEO,
        rows,
        lambda r, i: dji_subtitles.rtk(r, i) if i != 7 else dji_subtitles.rtk(r, i).replace("58.", "158."),
    )
    track = read_telemetry(Telemetry(file=path))
    assert track.left_out == {"impossible": 1}
    assert track.first_left_out["impossible"] == f"{path} text track, cue 8"
    assert len(track.times_s) == len(rows.times_s) - 1


def test_a_stream_without_telemetry_takes_that_of_its_video() -> None:
    stream = Stream.model_validate({"id": "a", "video": "DJI_0001.MP4", "camera": "c.yaml", "site": "a"})
    assert stream.telemetry.file == Path("DJI_0001.MP4")


@pytest.mark.parametrize("format_name", ["auto", "video-subtitles"])
def test_a_video_without_telemetry_is_refused_with_the_way_out(format_name: str) -> None:
    with pytest.raises(
        InputError, match=r"a video without a telemetry track; expected .*SRT beside the video"
    ):
        read_telemetry(Telemetry(file=VIDEO, format=format_name))


def test_a_track_that_only_dji_reads_is_called_by_its_name(tmp_path: Path, rows: Track) -> None:
    path = tmp_path / "drone.mp4"
    video_text_track.write(path, VIDEO, rows, dji_subtitles.brackets)
    video_text_track.as_dji_data_track(path)
    with pytest.raises(InputError, match=r"DJI's own data track \(djmd\).*; expected .*Video Subtitles"):
        read_telemetry(Telemetry(file=path))


def test_subtitles_that_are_no_telemetry_are_refused(tmp_path: Path, rows: Track) -> None:
    path = tmp_path / "film.mkv"
    video_text_track.write(path, VIDEO, rows, lambda r, i: f"He said {i} words.")
    with pytest.raises(InputError, match="subtitles without positions"):
        read_telemetry(Telemetry(file=path))


def test_a_video_that_is_cut_off_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "drone.mp4"
    path.write_bytes(VIDEO.read_bytes()[:100_000])
    with pytest.raises(InputError, match="a video that cannot be opened"):
        read_telemetry(Telemetry(file=path))
