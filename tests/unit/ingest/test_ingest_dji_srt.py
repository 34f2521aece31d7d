"""Each dialect of DJI's telemetry, and each way in which a file can be broken."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.ingest.telemetry.dji_srt import read_dji_srt
from pipeline.ingest.trajectory import require_complete

SHARED = Path(__file__).parents[4] / "shared/data/telemetry"
CUE = """{number}
00:00:00,{start:03d} --> 00:00:00,{end:03d}
<font size="28">FrameCnt: {number}, DiffTime: 33ms
2024-05-01 10:00:00.{start:03d}
[iso: 100] [latitude: {latitude}] [longitude: 15.1] [rel_alt: 15.000 abs_alt: 120.500] {gimbal}</font>

"""
GIMBAL = "[gb_yaw: 90.0 gb_pitch: -45.0 gb_roll: 1.5] "


def cue(number: int, latitude: str = "59.123456789", gimbal: str = GIMBAL) -> str:
    start = 33 * (number - 1)
    return CUE.format(number=number, start=start, end=start + 33, latitude=latitude, gimbal=gimbal)


def write(path: Path, *cues: str) -> Path:
    path.write_text("".join(cues), encoding="utf-8")
    return path


def test_the_dialect_with_gimbal_angles_gives_every_field(tmp_path: Path) -> None:
    path = write(tmp_path / "drone.srt", cue(1), cue(2), cue(3))
    track = read_dji_srt(path)
    require_complete(track, path)
    assert track.start_time_ns == 1_714_557_600_000_000_000
    assert track.times_s.tolist() == [0.0, 0.033, 0.066]
    assert (track.latitude_deg[0], track.longitude_deg[0]) == (59.123456789, 15.1)
    assert (track.absolute_height_m[0], track.relative_height_m[0]) == (120.5, 15.0)
    angles = np.degrees([track.yaw_rad[0], track.pitch_rad[0], track.roll_rad[0]])
    assert angles == pytest.approx([90.0, -45.0, 1.5])


def test_byte_order_mark_and_line_ends_do_not_matter(tmp_path: Path) -> None:
    text = cue(1) + cue(2)
    path = tmp_path / "drone.srt"
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    plain = read_dji_srt(write(tmp_path / "plain.srt", text))
    marked = read_dji_srt(path)
    assert plain.start_time_ns == marked.start_time_ns
    for name in ("times_s", "latitude_deg", "longitude_deg", "absolute_height_m", "yaw_rad"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(marked, name))


def test_a_dialect_without_gimbal_angles_is_read_but_not_complete(tmp_path: Path) -> None:
    path = write(tmp_path / "drone.srt", cue(1, gimbal=""), cue(2, gimbal=""))
    track = read_dji_srt(path)
    assert np.isnan(track.yaw_rad).all()
    with pytest.raises(
        InputError, match=r"drone\.srt: found telemetry without gimbal yaw; expected .*gb_yaw"
    ):
        require_complete(track, path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "found no sample"),
        ("no telemetry\nat all\n", "found no sample"),
        ("00:00 --> what\n", ":1: found text that is not SRT"),
        (cue(1) + cue(2, latitude="north"), r":9 latitude: found 'north'; expected a number"),
        (cue(1) + cue(2, latitude="nan"), r":9 latitude: found 'nan'"),
        (cue(1) + cue(2, latitude="91.0"), r":9 latitude: found 91; expected at most 90 degrees"),
        (cue(1) + cue(2, gimbal=""), r":9: found a sample without pitch"),
        (cue(1, gimbal="") + cue(2), r":9: found a sample with pitch"),
        (cue(1) + cue(1), r":9: found 0.000 s after 0.000 s; expected times that increase"),
        (cue(1).replace("2024-05", "2024-15"), r":3: found '2024-15-01 10:00:00.000'; expected a date"),
        (cue(1, "0.000").replace("15.1", "0.0"), r":3: found latitude 0 and longitude 0"),
    ],
)
def test_a_broken_file_is_refused_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_dji_srt(write(tmp_path / "drone.srt", text))


def test_a_missing_and_a_binary_file_are_refused(tmp_path: Path) -> None:
    binary = tmp_path / "drone.srt"
    binary.write_bytes(bytes(range(256)))
    for path, found in ((tmp_path / "no.srt", "no file"), (binary, "not text")):
        with pytest.raises(InputError, match=found):
            read_dji_srt(path)


# first position, last relative height, last absolute height, samples, UTC of the first sample
REAL = {
    "air2s.srt": (41.424724, 2.234156, None, 117.1, 17, 1_659_879_640_774_808_000),
    "matrice_300.srt": (36.6146, -6.1120, 0.0, None, 381, 1_655_827_577_000_000_000),
    "mavic_2_style.SRT": (-20.2533, 149.0251, None, None, None, 1_501_942_311_393_525_000),
    "mavic_air.SRT": (None, None, None, None, 2, 1_519_027_491_265_847_000),
    "mavic_mini.SRT": (48.0771, -121.7458, 200.8, None, 117, 0),
    "mavic_pro.SRT": (-20.2533, 149.0251, 0.0, None, 468, 1_501_942_311_000_000_000),
    "old_format.SRT": (-20.2533, 149.0251, 0.0, None, 468, 1_501_942_311_000_000_000),
    "p4p_sample.SRT": (47.4692, 8.2090, 45.6, None, 5, 0),
}


@pytest.mark.parametrize("name", REAL)
def test_a_real_recording_says_where_the_drone_was(name: str) -> None:
    if not SHARED.exists():
        pytest.skip("no shared data beside the repository")
    latitude, longitude, relative, absolute, samples, start_ns = REAL[name]
    track = read_dji_srt(SHARED / name)
    found = (
        track.latitude_deg[0],
        track.longitude_deg[0],
        track.relative_height_m[-1],
        track.absolute_height_m[-1],
    )
    expected = [np.nan if value is None else value for value in (latitude, longitude, relative, absolute)]
    np.testing.assert_array_equal(found, expected)
    assert track.start_time_ns == start_ns
    assert samples is None or len(track.times_s) == samples
    assert (np.diff(track.times_s) > 0).all()
    with pytest.raises(InputError, match="telemetry without"):
        require_complete(track, SHARED / name)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("broken_empty.SRT", "found no sample"),
        ("broken_incomplete.SRT", ":117: found a sample without latitude"),
    ],
)
def test_a_real_broken_recording_is_refused(name: str, message: str) -> None:
    if not SHARED.exists():
        pytest.skip("no shared data beside the repository")
    with pytest.raises(InputError, match=message):
        read_dji_srt(SHARED / name)
