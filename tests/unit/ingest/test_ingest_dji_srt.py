"""Each dialect of DJI's telemetry, and each way in which a file can be broken."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.ingest.telemetry.dji_fields import fields_of
from pipeline.ingest.telemetry.dji_srt import read_dji_srt
from pipeline.ingest.track import Track

SHARED = Path(__file__).parents[4] / "shared/data"
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


def test_a_dialect_without_gimbal_angles_is_read(tmp_path: Path) -> None:
    track = read_dji_srt(write(tmp_path / "drone.srt", cue(1, gimbal=""), cue(2, gimbal="")))
    assert np.isnan(track.yaw_rad).all()
    assert track.left_out == {}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])
@pytest.mark.parametrize("line_end", ["\n", "\r\n", "\r"])
def test_encoding_and_line_ends_do_not_matter(tmp_path: Path, encoding: str, line_end: str) -> None:
    path = tmp_path / "drone.srt"
    text = PHANTOM_RTK.format(0, 1) + PHANTOM_RTK.format(1, 2)
    path.write_bytes(text.replace("\n", line_end).encode(encoding))
    track = read_dji_srt(path)
    assert np.degrees([track.yaw_rad[1], track.pitch_rad[1]]) == pytest.approx([28.2, -40.0])
    assert (track.latitude_deg[1], track.longitude_deg[1], track.relative_height_m[1]) == (
        58.401743,
        15.574815,
        76.19,
    )
    assert track.times_s.tolist() == [0.0, 1.0]
    assert track.end_s == 2.0


PHANTOM_RTK = """1
00:00:0{},000 --> 00:00:0{},000
F/6.3, SS 60, RTK (15.574815, 58.401743, 28), HOME (15.574800, 58.401700, 103.55m), D 75.36m, H 76.19m, """
PHANTOM_RTK += "H.S 0.30m/s, V.S 0.00m/s, F.PRY (-5.3°, 2.1°, 28.3°), G.PRY (-40.0°, 0.0°, 28.2°)\n\n"


@pytest.mark.parametrize(
    ("text", "latitude", "longitude", "relative"),
    [
        ("GPS(149.0251,-20.2533,16) BAROMETER:1.9", -20.2533, 149.0251, 1.9),
        ("GPS(36.6146,-6.1120,0.0M) BAROMETER:0.8M", 36.6146, -6.1120, 0.8),
        ("GPS (-121.7458, 48.0771, 17), D 221.21m, H 200.70m, H.S n/a", 48.0771, -121.7458, 200.7),
        ("GPS(39.906,116.391,69.8) BAROMETER(91.2) \nHOME(39.9,116.4) D=5.2m H=1.5m", 39.906, 116.391, 1.5),
        ("GPS(149.0,-20.2,69.800) BAROMETER:-3.5", -20.2, 149.0, -3.5),
        ("GPS(39.9,116.4,18) BAROMETER:2.0", 39.9, 116.4, 2.0),
        (
            "F/3.5, SS 1000, GPS (24.0, 57.0, 72.5), D 24.26m, H 0.50m, G.PRY (-51.1°, 0.0°, -58.9°)",
            57.0,
            24.0,
            0.5,
        ),
        (
            "GPS(W: 97.109543, N: 32.593742, 174.21m)\nF.PRY (0.6°, 1.2°, -31.2°)",
            32.593742,
            -97.109543,
            174.21,
        ),
        ("HOME(E: 20.0, S: 1.0) 2025-01-01 12:00:01\nGPS(E: 20.5, S: 1.5, 001.01m)", -1.5, 20.5, 1.01),
        ("[latitude: 58,401743] [longitude: 15,574815], [rel_alt: 4,2]", 58.401743, 15.574815, 4.2),
        ("GPS(7.5,-33.9,11) Hb:-12.5 Hs:1.9", -33.9, 7.5, -12.5),
        ("[latitude : -20.2533] [longtitude : 149.0251] [rel_alt: 4.2]", -20.2533, 149.0251, 4.2),
        ("<b>GPS(10.5,-60.25,9)</b>\nBAROMETER: 7", -60.25, 10.5, 7.0),
        ("RTK(-0.1277, 51.5007, 31), H 12m", 51.5007, -0.1277, 12.0),
    ],
)
def test_the_order_and_sign_of_a_position_are_those_of_the_dialect(
    text: str, latitude: float, longitude: float, relative: float
) -> None:
    fields, _ = fields_of(text)
    assert (fields["latitude"], fields["longitude"], fields["relative_height"]) == (
        latitude,
        longitude,
        relative,
    )


def test_an_order_that_is_assumed_is_said_and_can_be_told(tmp_path: Path) -> None:
    text = "1\n00:00:00,000 --> 00:00:01,000\nGPS(48.40,15.57,69.800) BAROMETER(91.2)\n\n"
    path = write(tmp_path / "drone.srt", text)
    assumed, told = read_dji_srt(path), read_dji_srt(path, "longitude_first")
    assert (assumed.latitude_deg[0], told.latitude_deg[0]) == (48.40, 15.57)
    assert "telemetry.gps_order" in assumed.assumed[0]
    assert assumed.absolute_height_m[0] == told.absolute_height_m[0] == 69.8
    assert [a for a in told.assumed if "gps_order" in a] == []


def test_the_names_of_angles_differ_by_dialect() -> None:
    fields, _ = fields_of("[Gimbal_Yaw : 12.5] [gimbal_pitch: -40] [drone_yaw: 8.0] [drone_pitch: 1.0]")
    assert (fields["yaw"], fields["pitch"], fields["aircraft_yaw"]) == (12.5, -40.0, 8.0)
    fields, _ = fields_of("F.PRY (0.6°, 1.2°, -31.2°), G.PRY (-40.3°, 0.0°, -30.2°)")
    assert (fields["aircraft_roll"], fields["aircraft_yaw"], fields["pitch"], fields["yaw"]) == (
        1.2, -31.2, -40.3, -30.2,
    )  # fmt: skip


def test_a_height_that_nobody_names_is_used_as_told_and_said(tmp_path: Path) -> None:
    text = "1\n00:00:00,000 --> 00:00:01,000\nGPS(E: 15.5, N: 58.4, 45.50m)\n\n"
    track = read_dji_srt(write(tmp_path / "drone.srt", text))
    assert (track.absolute_height_m[0], track.relative_height_m[0]) == (45.5, 45.5)
    assert "Autel does not say which it is" in track.assumed[0]


@pytest.mark.parametrize(
    ("text", "focal_mm"), [("240", 24.0), ("24.00", 24.0), ("166", 16.6), ("1620.0", 1620.0)]
)
def test_focal_lengths_are_in_millimetres_or_tenths(text: str, focal_mm: float) -> None:
    assert fields_of(f"[focal_len: {text}]")[0]["focal_length_35mm"] == pytest.approx(focal_mm)


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (cue(2, latitude="north"), "unreadable"),
        (cue(2, latitude="nan"), "unreadable"),
        (cue(2, latitude="91.0"), "impossible"),
        (cue(2, latitude="59.9"), "impossible"),
        (cue(2, gimbal="[gb_yaw: 90.0 gb_pitch: -450.0 gb_roll: 0] "), "impossible"),
        (cue(2, gimbal=""), "incomplete"),
        (cue(2)[:150] + "\n\n", "incomplete"),
        (cue(1), "repeated"),
        (cue(4) + cue(2), "out_of_order"),
        (cue(2, "0.000").replace("15.1]", "0.0]"), "no_fix"),
        ("2\n00:00:00,033 --> 00:00:00,066\n\n\n", "empty"),
        (cue(2).replace("00:00:00,033 -->", "00:zz:00,033 -->"), "impossible"),
        (cue(2).replace("00:00:00,033 -->", "9" * 40 + ":00:00,033 -->"), "impossible"),
    ],
)
def test_a_bad_sample_costs_itself_and_is_counted_and_named(tmp_path: Path, bad: str, reason: str) -> None:
    track = read_dji_srt(write(tmp_path / "drone.srt", cue(1), bad, cue(3), cue(5), cue(6)))
    assert track.left_out == {reason: 1}
    assert track.first_left_out[reason].startswith(f"{tmp_path}/drone.srt:")
    assert {0.0, 0.066, 0.132, 0.165} <= set(track.times_s.tolist())
    assert (track.latitude_deg == 59.123456789).all()


def test_the_line_of_a_bad_sample_is_its_own(tmp_path: Path) -> None:
    track = read_dji_srt(write(tmp_path / "drone.srt", cue(1), cue(2, latitude="x"), cue(3)))
    assert track.first_left_out["unreadable"].endswith("drone.srt:9")


def test_a_date_that_does_not_exist_costs_the_date_only(tmp_path: Path) -> None:
    track = read_dji_srt(write(tmp_path / "drone.srt", cue(1).replace("2024-05", "2024-15"), cue(2)))
    assert track.start_time_ns == 1_714_557_600_000_000_000
    assert len(track.times_s) == 2


def test_a_clock_that_is_set_in_flight_is_believed_by_most_of_its_dates(tmp_path: Path) -> None:
    wrong = [cue(k).replace("2024-05-01 10:00", "1999-11-30 00:00") for k in (1, 2)]
    track = read_dji_srt(write(tmp_path / "drone.srt", *wrong, cue(3), cue(4), cue(5)))
    assert track.start_time_ns == 1_714_557_600_000_000_000
    assert len(track.times_s) == 5
    assert "2 dates that the other 3 contradict" in track.assumed[0]
    assert track.assumed[0].endswith("drone.srt:3)")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", "an empty file"),
        ("no telemetry\nat all\n", "no cue"),
        ("1\n00:00 --> what\n", "without positions"),
        ("1\n00:00:00,000 --> 00:00:01,000\nHello\n\n", "without positions"),
    ],
)
def test_a_file_with_nothing_to_use_is_refused(tmp_path: Path, text: str, found: str) -> None:
    with pytest.raises(InputError, match=f"found .*{found}"):
        read_dji_srt(write(tmp_path / "drone.srt", text))


def test_a_missing_and_a_binary_file_are_refused(tmp_path: Path) -> None:
    binary = tmp_path / "drone.srt"
    binary.write_bytes(bytes(8) + bytes(range(256)))
    for path, found in ((tmp_path / "no.srt", "no file"), (binary, "not text")):
        with pytest.raises(InputError, match=found):
            read_dji_srt(path)


def test_cues_without_times_count_from_their_dates(tmp_path: Path) -> None:
    rows = [
        f"{k}\n2017.08.05 14:11:5{k},393,525\n[latitude : -20.25] [longtitude : 149.02]\n\n"
        for k in (1, 2, 2, 5)
    ]
    track = read_dji_srt(write(tmp_path / "drone.srt", *rows))
    assert track.times_s.tolist() == pytest.approx([0.0, 1.0, 4.0])
    assert track.left_out == {"repeated": 1}


def test_few_satellites_and_rtk_are_uncertainty() -> None:
    assert fields_of("GPS(149.0,-20.2,4)")[0]["horizontal_sd"] > 1.0
    assert fields_of("RTK(149.0,-20.2,28)")[0]["horizontal_sd"] <= 0.1
    assert "horizontal_sd" not in fields_of("GPS(149.0,-20.2,16)")[0]


DEMO_NS = 1_781_429_400 * 10**9
# samples, first latitude, longitude, absolute height, relative height, yaw, pitch, date, left out
NAN = np.nan
REAL = {
    "T/air2s.srt": (17, 41.424724, 2.234156, 117.0, 117.0, NAN, NAN, 1_659_879_640_774_808_000, {}),
    "T/matrice_300.srt": (381, 36.6146, -6.1120, NAN, 0.3, NAN, NAN, 1_655_827_577_000_000_000, {}),
    "T/mavic_2_style.SRT": (463, -20.2533, 149.0251, NAN, NAN, NAN, NAN, 1_501_942_311_393_525_000, {"repeated": 5}),
    "T/mavic_mini.SRT": (117, 48.0771, -121.7458, NAN, 200.7, NAN, NAN, 0, {}),
    "T/mavic_pro.SRT": (468, -20.2533, 149.0251, NAN, 1.9, NAN, NAN, 1_501_942_311_000_000_000, {}),
    "T/old_format.SRT": (468, -20.2533, 149.0251, NAN, 1.9, NAN, NAN, 1_501_942_311_000_000_000, {}),
    "T/p4p_sample.SRT": (5, 47.4692, 8.2090, NAN, 45.6, NAN, NAN, 0, {}),
    "T/broken_incomplete.SRT": (19, -34.7383, -58.4563, NAN, 20.1, NAN, NAN, 1_499_076_903_000_000_000, {"empty": 1}),
    "C/10Hz.srt": (40, 58.401743332, 15.574815181, 128.651, 15.384, 0.0, -45.0, DEMO_NS, {}),
    "C/avata2_lat_first.srt": (2, 48.401743, 15.574815, 69.8, NAN, NAN, NAN, 0, {}),
    "C/cut30.srt": (210, 58.401770266, 15.574815181, 128.801, 15.534, 0.0, -45.0, DEMO_NS + 10**9, {}),
    "C/cut_in_middle.srt": (4, 58.4017433, 15.5748151, 128.651, 15.384, 0.0, -45.0, DEMO_NS, {"incomplete": 1}),
    "C/drone-2h.srt": (240, 58.401743333, 15.575328273, 125.571, 14.665, 0.0, -45.0, DEMO_NS + 3600 * 10**9, {}),
    "C/dup_time.srt": (4, 58.4017433, 15.5748151, 128.651, 15.384, 0.0, -45.0, DEMO_NS, {"repeated": 1}),
    "C/home20.srt": (240, 58.401743332, 15.574815181, 128.651, 35.384, 0.0, -45.0, DEMO_NS, {}),
    "C/hz1.srt": (8, 58.401743332, 15.574815181, 128.651, 15.384, 0.0, -45.0, DEMO_NS, {}),
    "C/less4.srt": (236, 58.401743332, 15.574815181, 128.651, 15.384, 0.0, -45.0, DEMO_NS, {}),
    "C/m300_h20_gpry.srt": (4, 58.401743, 15.574815, NAN, 45.0, 90.0, -60.0, 0, {}),
    "C/m3e_wide.srt": (4, 58.401743, 15.574815, 426.185, 102.229, -65.8, -89.9, 1_732_469_883_576_000_000, {}),
    "C/m4t_embedded.srt": (4, 58.401743, 15.574815, 169.523, 20.160, -77.4, 7.4, 1_790_263_255_713_000_000, {}),
    "C/mixed_gap_nofix.srt": (4, 58.401743, 15.574815, 426.185, 102.229, -65.8, -60.0, 1_732_469_883_576_000_000, {}),
    "C/nofix30.srt": (210, 58.401770266, 15.574815181, 128.801, 15.534, 0.0, -45.0, DEMO_NS + 10**9, {"no_fix": 30}),
    "C/one_hertz.srt": (47, 58.401743332, 15.574815181, 128.651, 15.384, 0.0, -45.0, DEMO_NS, {}),
    "C/p4rtk_rtk.srt": (4, 58.401743, 15.574815, NAN, 76.19, 28.2, -40.0, 0, {}),
    "C/short_by_2_cues.srt": (118, 58.401743332, 15.574815181, 128.651, 15.384, 0.0, -45.0, DEMO_NS, {}),
    "C/srt_timestamp_overflow.srt":
        (10, 58.401743332, 15.574815181, 128.651, 15.384, 0.0, -45.0, DEMO_NS, {"out_of_order": 2}),
    "C/trailing_empty_cue.srt": (5, 58.4017433, 15.5748151, 128.651, 15.384, 0.0, -45.0, DEMO_NS, {"empty": 1}),
    "C/zero_fix_one_mid.srt": (4, 58.4017433, 15.5748151, 128.651, 15.384, 0.0, -45.0, DEMO_NS, {"no_fix": 1}),
    "C/zoom.srt": (240, 58.401743332, 15.574815181, 128.651, 15.384, 0.0, -45.0, DEMO_NS, {}),
}  # fmt: skip


def shared(name: str) -> Track:
    if not SHARED.exists():
        pytest.skip("no shared data beside the repository")
    folder, _, file = name.partition("/")
    return read_dji_srt(SHARED / {"T": "telemetry", "C": "cases/telemetry"}[folder] / file)


@pytest.mark.parametrize("name", REAL)
def test_a_real_recording_is_read_to_the_values_in_it(name: str) -> None:
    track = shared(name)
    samples, *values, start_ns, left_out = REAL[name]
    found = [
        track.latitude_deg[0],
        track.longitude_deg[0],
        track.absolute_height_m[0],
        track.relative_height_m[0],
        np.degrees(track.yaw_rad[0]),
        np.degrees(track.pitch_rad[0]),
    ]
    np.testing.assert_allclose(found, values, atol=1e-9)
    assert (len(track.times_s), track.start_time_ns, track.left_out) == (samples, start_ns, left_out)
    assert (np.diff(track.times_s) > 0).all()


def test_a_zoom_doubles_the_focal_length_once() -> None:
    focal_mm = shared("C/zoom.srt").focal_length_35mm
    assert focal_mm is not None
    assert (focal_mm[119], focal_mm[120]) == (24.0, 48.0)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("broken_empty.SRT", "an empty file"),
        ("mavic_air.SRT", "subtitles without positions or gimbal angles"),
    ],
)
def test_a_real_recording_without_positions_is_refused(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        shared(f"T/{name}")
