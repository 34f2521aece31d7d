"""Subtitles as drones, converters and people of other habits write them: the same values come out, or it is said."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.telemetry.dji_fields import date_ns, fields_of
from pipeline.ingest.telemetry.dji_shapes import CueReader
from pipeline.ingest.telemetry.subtitles import cues_of
from pipeline.ingest.track import Track

BRACKETS = (
    "2024-05-01 10:00:0{i}.000\n[iso: 100] [latitude: 48.40174{i}] [longitude: 15.574815] "
    "[rel_alt: 35.300 abs_alt: 128.650] [gb_yaw: 90.0 gb_pitch: -45.0 gb_roll: 0.0]"
)
TIME_LINE = "00:00:0{i},000 --> 00:00:0{j},000"


def written(
    folder: Path, text: str, time_line: str = TIME_LINE, name: str = "drone.srt", cues: int = 5
) -> Path:
    path = folder / name
    cue = "{number}\n" + time_line + "\n" + text + "\n\n"
    path.write_text(
        "".join(cue.format(number=i + 1, i=i, j=i + 1, ms=33 * i, next=33 * i + 33) for i in range(cues)),
        encoding="utf-8",
    )
    return path


def read(path: Path) -> Track:
    return read_telemetry(Telemetry(file=path))


SAME = {
    "spaces about everything": BRACKETS.replace("[", "[ ").replace(":", " : ").replace("]", " ]"),
    "equals signs": BRACKETS.replace(": ", "="),
    "commas between, glued": BRACKETS.replace("] [", ",").replace(": ", ":").replace(" abs", ",abs"),
    "decimal commas": BRACKETS.replace(".", ","),
    "decimal commas, glued": BRACKETS.replace("] [", ",").replace(": ", ":").replace(".", ","),
    "units behind": BRACKETS.replace("35.300", "35.300m").replace("128.650", "128.650m").replace("-45.0", "-45.0°"),
    "units apart": BRACKETS.replace("35.300", "35.300 m").replace("128.650", "128.650 m").replace("-45.0", "-45.0 °"),
    "feet": BRACKETS.replace("35.300", "115.8136ft").replace("128.650", "422.0801ft"),
    "feet apart": BRACKETS.replace("35.300", "115.8136 ft").replace("128.650", "422.0801 feet"),
    "a minus that is none": BRACKETS.replace("-45", "\u221245"),
    "capitals": BRACKETS.replace("latitude", "Latitude").replace("rel_alt", "REL_ALT").replace("gb_yaw", "GB_YAW"),
    "short names": BRACKETS.replace("latitude", "lat").replace("longitude", "lng").replace("rel_alt", "RelAlt"),
    "hemispheres": BRACKETS.replace("{i}]", "{i}N]").replace("15.574815", "E15.574815"),
    "home beside it": BRACKETS + " [home_latitude: 1.0] [home_longitude: 2.0]",
}  # fmt: skip


@pytest.mark.parametrize("name", SAME)
def test_other_habits_of_writing_change_no_value(tmp_path: Path, name: str) -> None:
    track = read(written(tmp_path, SAME[name]))
    assert track.left_out == {}
    assert track.latitude_deg.tolist() == pytest.approx(
        [48.401740, 48.401741, 48.401742, 48.401743, 48.401744]
    )
    found = [track.longitude_deg[1], track.relative_height_m[1], track.absolute_height_m[1]]
    assert found == pytest.approx([15.574815, 35.3, 128.65], abs=1e-4)
    assert np.degrees([track.yaw_rad[1], track.pitch_rad[1]]) == pytest.approx([90.0, -45.0])


@pytest.mark.parametrize(
    ("latitude", "longitude", "is_south", "is_west"),
    [("48.4S", "15.5W", True, True), ("S48.4", "E15.5", True, False), ("48.4 S", "15.5 W", True, True),
     ("N 48.4", "W 15.5", False, True), ("48.4 N", "-15.5 W", False, True),
     ("48°24'00\"S", "15°30'00\"E", True, False)],
)  # fmt: skip
def test_a_hemisphere_is_a_sign(latitude: str, longitude: str, is_south: bool, is_west: bool) -> None:
    fields, _ = fields_of(f"[latitude: {latitude}] [longitude: {longitude}] [rel_alt: 3]")
    assert fields["latitude"] == pytest.approx(-48.4 if is_south else 48.4)
    assert fields["longitude"] == pytest.approx(-15.5 if is_west else 15.5)


BRACED = {
    "decimal commas of heights": "GPS (15.574815, 48.401743, 15), D 24,11m, H 35,48m, H.S 5,9m/s, V.S -0,9m/s",
    "decimal commas of all": "GPS (15,574815, 48,401743, 15), D 24,11m, H 35,48m, G.PRY (-45,0°, 0,5°, 90,0°)",
    "semicolons": "GPS (15.574815; 48.401743; 15); D 24.11m; H 35.48m; G.PRY (-45.0; 0.5; 90.0)",
    "colons": "GPS: (15.574815, 48.401743, 15), D: 24.11m, H: 35.48m, G.PRY: (-45.0, 0.5, 90.0)",
    "feet": "GPS (15.574815, 48.401743, 15), D 79.1ft, H 116.4042ft, G.PRY (-45.0, 0.5, 90.0)",
    "barometer with a comma": "GPS(15.574815,48.401743,15) BAROMETER:35,48M",
    "barometer with a space": "GPS(15.574815,48.401743,15) BAROMETER: 35.48 M",
    "Autel, latitude first": "GPS(N: 48.401743, E: 15.574815, 35.48m)\nG.PRY (-45.0, 0.5, 90.0)",
    "Autel, degrees and a space": "GPS(E: 15.574815°, N: 48.401743°, 35.48 m)",
    "Autel, in feet": "GPS(E: 15.574815, N: 48.401743, 116.4042ft)",
}


@pytest.mark.parametrize("name", BRACED)
def test_values_in_brackets_are_read_in_every_way_to_write_them(name: str) -> None:
    fields, _ = fields_of(BRACED[name])
    assert (fields["latitude"], fields["longitude"]) == pytest.approx((48.401743, 15.574815))
    assert fields["relative_height"] == pytest.approx(35.48, abs=1e-3)
    if "PRY" in BRACED[name]:
        assert (fields["pitch"], fields["roll"], fields["yaw"]) == (-45.0, 0.5, 90.0)


@pytest.mark.parametrize("odd", ["1.1.", "1..1", "-", "1,1.1", "+-3", ".", "1e", "1.e5.", "\u22121.5.2"])
def test_what_is_nearly_a_number_is_none_or_nan(odd: str) -> None:
    for text in (
        f"H {odd}m",
        f"GPS({odd}, 48.4, 15)",
        f"G.PRY ({odd}, 0, 90)",
        f"[rel_alt: {odd}]",
        f"DZOOM {odd},",
    ):
        fields, _ = fields_of(text)
        assert all(np.isnan(v) or abs(v) < 1e6 for v in fields.values()), text


def test_a_minus_beside_west_says_west_again() -> None:
    fields, _ = fields_of("GPS(W: -9.1, N: 48.9, 350.1m)")
    assert (fields["latitude"], fields["longitude"]) == (48.9, -9.1)


def test_two_values_are_a_position_whose_order_is_said_or_told() -> None:
    fields, assumed = fields_of("GPS (15.5, 48.4), H 35m")
    assert (fields["latitude"], fields["longitude"]) == (48.4, 15.5)
    assert "gps_order: latitude_first" in assumed[0]
    assert fields_of("GPS (15.5, 48.4)", "latitude_first") == ({"latitude": 15.5, "longitude": 48.4}, [])


TIME_LINES = {
    "without hours": "00:0{i}.000 --> 00:0{j}.000",
    "WebVTT with settings": "00:00:0{i}.000 --> 00:00:0{j}.000 align:left position:0%",
    "without a fraction": "00:00:0{i} --> 00:00:0{j}",
    "a colon before thousandths": "00:00:0{i}:000 --> 00:00:0{j}:000",
    "spaces": "00 : 00 : 0{i} , 000 --> 00 : 00 : 0{j} , 000",
    "no space about the arrow": "00:00:0{i},000-->00:00:0{j},000",
    "one digit of hours": "0:00:0{i}.00 --> 0:00:0{j}.00",
}


@pytest.mark.parametrize("name", TIME_LINES)
def test_every_way_to_write_a_time_is_that_time(tmp_path: Path, name: str) -> None:
    track = read(written(tmp_path, BRACKETS, TIME_LINES[name]))
    assert track.times_s.tolist() == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0])
    assert (track.end_s, track.left_out) == (pytest.approx(5.0), {})


def test_thousandths_that_are_not_padded_are_thousandths(tmp_path: Path) -> None:
    path = written(tmp_path, BRACKETS, "00:00:00,{ms} --> 00:00:00,{next}", cues=9)
    assert read(path).times_s.tolist() == pytest.approx([0.033 * k for k in range(9)])


def test_fractions_of_any_length_that_are_in_order_are_fractions(tmp_path: Path) -> None:
    cues = [
        f"{k}\n00:00:0{t} --> 00:00:09\n{BRACKETS.format(i=k)}\n\n"
        for k, t in enumerate(["0.5", "1.25", "1.5"])
    ]
    path = tmp_path / "drone.srt"
    path.write_text("".join(cues), encoding="utf-8")
    assert read(path).times_s.tolist() == pytest.approx([0.5, 1.25, 1.5])


@pytest.mark.parametrize("name", ["DJI_0001.txt", "DJI_0001.vtt", "DJI_0001.SRT.bak", "telemetry"])
def test_subtitles_are_known_by_their_content_whatever_the_file_is_called(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, BRACKETS, name=name)
    if name.endswith("vtt"):
        path.write_text("WEBVTT - DJI\n\n" + path.read_text(encoding="utf-8"), encoding="utf-8")
    assert len(read(path).times_s) == 5


@pytest.mark.parametrize(
    ("text", "date"),
    [
        ("2024-05-01 02:00:07 PM", "2024-05-01T14:00:07"),
        ("2024-05-01 12:00:07 a.m.", "2024-05-01T00:00:07"),
        ("2024-05-01T14:00:07.500Z", "2024-05-01T14:00:07.5"),
        ("01.05.2024 14:00:07", "2024-05-01T14:00:07"),
        ("2024.5.1 14:00:07,123,456", "2024-05-01T14:00:07.123456"),
        ("2024-05-01 13:00:07 PM", None),
        ("31.02.2024 14:00:07", None),
    ],
)
def test_dates_in_halves_of_days_and_with_the_day_first(text: str, date: str | None) -> None:
    assert date_ns(text) == (None if date is None else int(np.datetime64(date, "ns").astype(np.int64)))


def zoomed(folder: Path, *extra: str) -> Track:
    cues = [
        f"{k + 1}\n00:00:0{k},000 --> 00:00:0{k + 1},000\n{BRACKETS.format(i=k)} {words}\n\n"
        for k, words in enumerate(extra)
    ]
    path = folder / "drone.srt"
    path.write_text("".join(cues), encoding="utf-8")
    return read(path)


@pytest.mark.parametrize(
    ("pairs", "focal_mm", "said"),
    [
        # the focal length stands still while the zoom changes: it does not hold it
        ([(240, 10000), (240, 20000), (240, 40000)], [24.0, 48.0, 96.0], "multiplied onto"),
        ([("24.00", "1.00"), ("24.00", "1.50"), ("24.00", "2.00")], [24.0, 36.0, 48.0], "multiplied onto"),
        # both change together
        ([(240, 10000), (480, 20000), (960, 40000)], [24.0, 48.0, 96.0], "change together"),
        # an optical zoom first, then a digital one beside it
        ([("24.00", "1.0"), ("48.00", "1.0"), ("48.00", "2.0")], [24.0, 48.0, 96.0], "multiplied onto"),
        # throughout: no lens has 10 mm; one of 24 mm may be
        ([("20.00", "2.0")] * 3, [40.0] * 3, "no lens is as wide as 10 mm"),
        ([("48.00", "2.0")] * 3, [48.0] * 3, "holds the digital zoom of 2"),
        ([(240, 10000)] * 3, [24.0] * 3, None),
    ],
)
def test_a_digital_zoom_counts_once(
    tmp_path: Path, pairs: list[tuple[object, object]], focal_mm: list[float], said: str | None
) -> None:
    track = zoomed(tmp_path, *(f"[focal_len: {f}] [dzoom_ratio: {z}, delta:0]" for f, z in pairs))
    assert track.focal_length_35mm is not None
    assert track.focal_length_35mm.tolist() == pytest.approx(focal_mm)
    assert track.digital_zoom is None
    assert len(track.assumed) == (0 if said is None else 1)
    assert said is None or said in track.assumed[0]


@pytest.mark.parametrize("wrong", ["1e-323", "9" * 300, "-2.0", "0", "nan"])
def test_zooms_and_focal_lengths_that_cannot_be_tell_nothing(tmp_path: Path, wrong: str) -> None:
    usual = "[focal_len: 24.00] [dzoom_ratio: 1.0]"
    for odd in (usual.replace("24.00", wrong), usual.replace("1.0", wrong)):
        track = zoomed(tmp_path, usual, odd, usual.replace("1.0", "2.0"), usual)
        assert track.focal_length_35mm is not None
        assert track.focal_length_35mm[[0, -1]].tolist() == [24.0, 24.0]
        assert 48.0 in track.focal_length_35mm.tolist()


@pytest.mark.parametrize("form", ["[dzoom_ratio: {}]", "DZOOM {},", "[dzoom: {}]"])
def test_a_digital_zoom_without_a_focal_length_counts_from_the_whole_picture(
    tmp_path: Path, form: str
) -> None:
    track = zoomed(tmp_path, *(form.format(z) for z in ("1.0", "1.0", "2.0")))
    assert track.focal_length_35mm is None
    assert track.digital_zoom is not None
    assert track.digital_zoom.tolist() == [1.0, 1.0, 2.0]
    assert "the whole picture" in track.assumed[-1]


def test_an_altitude_of_no_kind_is_used_as_the_mission_says_and_that_is_said(tmp_path: Path) -> None:
    text = "[latitude: 48.4] [longitude: 15.5] [altitude: 117.0]"
    track = read(written(tmp_path, text))
    assert track.absolute_height_m[0] == track.relative_height_m[0] == 117.0
    assert track.height_is_either
    assert "telemetry.height" in track.assumed[0]
    both = read(written(tmp_path, text.replace("117.0", "117.0] [rel_alt: 20.0")))
    assert (both.absolute_height_m[0], both.relative_height_m[0], both.height_is_either) == (
        117.0,
        20.0,
        False,
    )


def test_longitudes_from_0_to_360_are_turned_and_a_single_one_is_a_fault(tmp_path: Path) -> None:
    track = read(written(tmp_path, BRACKETS.replace("15.574815", "344.425185")))
    assert track.longitude_deg.tolist() == pytest.approx([-15.574815] * 5)
    assert "0 to 360" in track.assumed[0]
    path = written(tmp_path, BRACKETS)
    path.write_text(path.read_text().replace("15.574815", "344.425185", 1), encoding="utf-8")
    assert read(path).left_out == {"impossible": 1}


def test_numbers_that_cannot_be_told_apart_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="without positions"):
        read(written(tmp_path, "GPS(15,574815,48,401743,15) H 35m"))


def random_cue(rng: np.random.Generator) -> str:
    """Of one of several shapes, with any numbers in it, and now and then a field that is not there or is no number."""
    number = lambda most: f"{rng.uniform(-most, most):.{rng.integers(0, 10)}f}"  # noqa: E731
    heights = (
        f"[rel_alt: {number(99)} abs_alt: {number(99)}]",
        f"[altitude: {number(99)}]",
        "",
        "[rel_alt: x]",
    )
    angles = (
        f"[gb_yaw: {number(180)} gb_pitch: {number(90)} gb_roll: 0.0]",
        f"G.PRY ({number(90)}, 0, 0)",
        "",
    )
    more = (
        "[dzoom_ratio: 10000, delta:0]",
        "[dzoom_ratio: 2.50]",
        "H 35.2m",
        "[rel_alt: 115.8 ft]",
        "48.4 N",
    )
    parts = [
        f"FrameCnt: {rng.integers(1, 10**6)}, DiffTime: {rng.integers(1, 99)}ms\n2024-05-01 10:00:0{rng.integers(9)}",
        f"[iso: {rng.integers(100, 6400)}] [shutter: 1/{number(500)}] [ev: {number(2)}]",
        f"[focal_len: {rng.choice([240, 24.0, 480])}] [latitude: {number(90)}] [longitude: {number(180)}]",
        *(str(rng.choice(options)) for options in (heights, angles, more)),
    ]
    return " ".join(parts)


def test_a_cue_of_a_known_shape_is_read_as_one_that_is_read_in_full() -> None:
    reader, rng = CueReader(None), np.random.default_rng(20_261_130)
    for _ in range(3000):
        text = random_cue(rng)
        fields, assumed = reader.fields(text)
        again, assumed_again = fields_of(text)
        assert {k: repr(v) for k, v in fields.items()} == {k: repr(v) for k, v in again.items()}, text
        assert assumed == assumed_again


def test_usual_time_lines_are_read_at_once_to_the_same_times(tmp_path: Path) -> None:
    line = "{h:02d}:{m:02d}:{s:02d},{f:03d}"
    rng = np.random.default_rng(7)
    whole = np.sort(rng.integers(0, 99 * 3_600_000, 300))
    times = [
        line.format(h=t // 3_600_000, m=t // 60_000 % 60, s=t // 1000 % 60, f=t % 1000)
        for t in whole.tolist()
    ]
    cues = "".join(f"1\n{a} --> {b}\nx\n\n" for a, b in itertools.pairwise(times))
    at_once = [(c.start_s, c.end_s) for c in cues_of("a", cues)]
    one_by_one = [
        (c.start_s, c.end_s) for c in cues_of("a", cues.replace("0 -->", "0  -->", 1) + "\n1\n0:0 --> 1:1\n")
    ]
    assert at_once == one_by_one[:-1]
    assert at_once[0][0] == pytest.approx(whole[0] / 1000.0)
