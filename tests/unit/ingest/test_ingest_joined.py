"""One file for each recording of a row: the flight as if it had been recorded in one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.config.mission import Stream, load_mission
from pipeline.errors import InputError
from pipeline.ingest.joined import joined
from pipeline.ingest.telemetry.dji_srt import read_dji_srt
from pipeline.ingest.track import Track
from tests.dialects import demo, dji_subtitles

WHOLE = demo.at_rate(demo.true_track("drone-1"), 5.0)


def parts(folder: Path, *starts: int) -> list[Track]:
    """The demo's flight cut at samples, each part with times from 0, as a camera writes them."""
    tracks = []
    for k, (begin, end) in enumerate(zip(starts, [*starts[1:], len(WHOLE.times_s)], strict=True)):
        arrays = {
            name: getattr(WHOLE, name)[begin:end]
            for name in ("latitude_deg", "longitude_deg", "absolute_height_m", "relative_height_m")
        } | {name: getattr(WHOLE, name)[begin:end] for name in ("yaw_rad", "pitch_rad", "roll_rad")}
        times_s = WHOLE.times_s[begin:end] - WHOLE.times_s[begin]
        date = WHOLE.start_time_ns + round(float(WHOLE.times_s[begin]) * 1e9)
        rows = replace(WHOLE, times_s=times_s, start_time_ns=date, **arrays)
        dji_subtitles.write(folder / f"{k}.srt", rows, dji_subtitles.brackets)
        tracks.append(read_dji_srt(folder / f"{k}.srt"))
    return tracks


@pytest.mark.parametrize("starts", [(0, 100), (0, 40, 41), (0, 1, 2, 200)])
def test_the_parts_of_a_flight_make_the_flight(tmp_path: Path, starts: tuple[int, ...]) -> None:
    tracks = parts(tmp_path, *starts)
    whole = joined(tracks, [float(WHOLE.times_s[k]) for k in starts], "here")
    np.testing.assert_allclose(whole.times_s, WHOLE.times_s, atol=0.002)
    np.testing.assert_allclose(whole.latitude_deg, WHOLE.latitude_deg, atol=1e-9)
    np.testing.assert_allclose(whole.yaw_rad, WHOLE.yaw_rad, atol=1e-5)
    assert abs(whole.start_time_ns - WHOLE.start_time_ns) < 10**6
    assert (np.diff(whole.times_s) > 0).all()


def test_a_part_ends_where_the_next_recording_begins(tmp_path: Path) -> None:
    tracks = parts(tmp_path, 0, 100)
    whole = joined(tracks, [0.0, 15.0], "here")
    assert (np.diff(whole.times_s) > 0).all()
    assert (whole.times_s[74], whole.times_s[75]) == (pytest.approx(14.8, abs=0.04), pytest.approx(15.0))


def test_what_was_left_out_of_all_parts_is_counted_and_a_field_that_one_lacks_is_unknown_there(
    tmp_path: Path,
) -> None:
    one, other = parts(tmp_path, 0, 100)
    one = replace(one, left_out={"no_fix": 2}, first_left_out={"no_fix": "0.srt:3"}, focal_length_35mm=None)
    other = replace(
        other, left_out={"no_fix": 1, "empty": 1}, first_left_out={"no_fix": "1.srt:9", "empty": "x"}
    )
    whole = joined([one, other], [0.0, 20.0], "here")
    assert whole.left_out == {"no_fix": 3, "empty": 1}
    assert whole.first_left_out == {"no_fix": "0.srt:3", "empty": "x"}
    assert whole.focal_length_35mm is not None
    assert np.isnan(whole.focal_length_35mm[:100]).all()
    assert not np.isnan(whole.focal_length_35mm[100:]).any()


def test_files_that_do_not_match_the_recordings_are_refused(tmp_path: Path) -> None:
    tracks = parts(tmp_path, 0, 100)
    with pytest.raises(InputError, match=r"2 telemetry files for 3 recordings; expected one for each"):
        joined(tracks, [0.0, 20.0, 30.0], "here")
    with pytest.raises(InputError, match="a clock of its own"):
        joined([tracks[0], replace(tracks[1], tied_to_video=False)], [0.0, 20.0], "here")


def test_a_mission_names_a_file_for_each_recording_or_takes_those_inside(tmp_path: Path) -> None:
    files = {"id": "a", "video": ["1.MP4", "2.MP4"], "camera": "c.yaml", "site": "a"}
    inside = Stream.model_validate(files).telemetry
    assert inside.files == (Path("1.MP4"), Path("2.MP4"))
    named = Stream.model_validate(files | {"telemetry": {"file": ["1.SRT", "2.SRT"]}}).telemetry
    assert named.files == (Path("1.SRT"), Path("2.SRT"))
    telemetry = {s: {"file": ["one.srt", "two.srt"]} for s in demo.STREAMS}
    mission = load_mission(demo.mission_with(tmp_path, telemetry))
    assert mission.streams[0].telemetry.files == (tmp_path / "one.srt", tmp_path / "two.srt")
