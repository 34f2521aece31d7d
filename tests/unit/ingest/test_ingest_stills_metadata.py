"""EXIF and XMP of stills become a track on the stills' own clock."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.telemetry.stills_metadata import dated_stills, tags_of
from tests.stills import write_still

START = datetime(2026, 5, 1, 12, 0, 0, 250_000)
XMP = {
    "AbsoluteAltitude": "+131.25",
    "RelativeAltitude": "+20.50",
    "GimbalYawDegree": "-35.5",
    "GimbalPitchDegree": "-80.0",
    "GimbalRollDegree": "+0.0",
}
PICTURE = np.zeros((48, 64, 3), np.uint8)


def folder_of(tmp_path: Path, count: int = 4, xmp: dict[str, str] | None = None, **how: str) -> Path:
    for k in range(count):
        taken = START + timedelta(seconds=2.5 * k)
        name = tmp_path / f"DJI_{9 - k}.JPG"
        write_still(name, PICTURE, taken, 58.4 + 1e-5 * k, -15.5, 140.0, XMP if xmp is None else xmp, **how)
    return tmp_path


def test_values_dates_and_order_are_those_of_the_files(tmp_path: Path) -> None:
    track = read_telemetry(Telemetry(file=folder_of(tmp_path)))
    assert track.times_s == pytest.approx([0.0, 2.5, 5.0, 7.5])
    assert track.latitude_deg == pytest.approx([58.4, 58.40001, 58.40002, 58.40003], abs=1e-8)
    assert track.longitude_deg == pytest.approx([-15.5] * 4, abs=1e-8)
    assert track.absolute_height_m == pytest.approx([131.25] * 4)
    assert track.relative_height_m == pytest.approx([20.5] * 4)
    assert np.degrees(track.yaw_rad) == pytest.approx([-35.5] * 4)
    assert np.degrees(track.pitch_rad) == pytest.approx([-80.0] * 4)
    assert track.focal_length_35mm == pytest.approx([24.0] * 4)
    assert (track.clock, track.camera_name) == ("local", "FC3411")
    assert track.start_time_ns == 1_777_636_800_250_000_000


def test_a_stated_offset_makes_the_dates_utc(tmp_path: Path) -> None:
    track = read_telemetry(Telemetry(file=folder_of(tmp_path, offset="+02:00")))
    assert (track.clock, track.start_time_ns) == ("utc", 1_777_629_600_250_000_000)


def test_without_xmp_the_position_is_that_of_the_exif(tmp_path: Path) -> None:
    track = read_telemetry(Telemetry(file=folder_of(tmp_path, xmp={})))
    assert track.absolute_height_m == pytest.approx([140.0] * 4)
    assert np.isnan(track.yaw_rad).all()


def test_a_still_without_a_date_costs_itself_and_a_folder_of_them_is_refused(tmp_path: Path) -> None:
    folder = folder_of(tmp_path)
    (folder / "broken.jpg").write_bytes(b"\xff\xd8\xff\xe1no picture")
    assert read_telemetry(Telemetry(file=folder)).left_out == {"no_date": 1}
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(InputError, match="no still with a date, of 0"):
        read_telemetry(Telemetry(file=empty))


def taken_at_once(folder: Path, letters: str, thermal: str = "T", count: int = 3) -> Path:
    """As drones of several cameras write them: at the same seconds, the thermal ones smaller."""
    for k in range(count):
        for letter in letters:
            taken = START + timedelta(seconds=2 * k)
            picture = PICTURE[:32, :40] if letter in thermal else PICTURE
            ending = f"_{letter}" if letter.isalpha() else letter
            write_still(folder / f"DJI_2026_{k:04}{ending}.JPG", picture, taken, 58.4, 15.5, 1.0, XMP)
    return folder


@pytest.mark.parametrize(("letters", "taken"), [("TV", "V"), ("TWZ", "W"), ("TZ", "Z"), ("tw", "w")])
def test_of_a_drones_cameras_one_is_taken_and_the_others_are_counted(
    tmp_path: Path, letters: str, taken: str
) -> None:
    stills, left_out = dated_stills(taken_at_once(tmp_path, letters, "Tt"))
    assert [s.path.name for s in stills] == [f"DJI_2026_{k:04}_{taken}.JPG" for k in range(3)]
    assert left_out.counts == {"other_camera": 3 * (len(letters) - 1)}
    assert read_telemetry(Telemetry(file=tmp_path)).left_out == left_out.counts


def test_of_pictures_of_several_sizes_the_usual_one_is_taken(tmp_path: Path) -> None:
    taken_at_once(tmp_path, "12", thermal="1")
    write_still(tmp_path / "more.jpg", PICTURE[:16, :16], START, 58.4, 15.5, 1.0, XMP)
    stills, left_out = dated_stills(tmp_path)
    assert {s.size for s in stills} == {(64, 48)}
    assert left_out.counts == {"other_camera": 4}


@pytest.mark.parametrize(("tag", "text"), [(0x9004, "2026:05:01 12:00:00"), (0x0132, "2026-05-01 12:00:00")])
def test_without_the_date_of_the_picture_that_of_the_file_is_taken(
    tmp_path: Path, tag: int, text: str
) -> None:
    exif = Image.Exif()
    (exif if tag == 0x0132 else exif.get_ifd(0x8769))[tag] = text
    Image.fromarray(PICTURE).save(tmp_path / "a.jpg", exif=exif)
    assert tags_of(tmp_path / "a.jpg").date_ns == 1_777_636_800_000_000_000


@pytest.mark.parametrize("letter", ["S", "s", b"S", b"S\0", " S"])
def test_a_southern_letter_is_a_sign_however_it_is_stored(tmp_path: Path, letter: str | bytes) -> None:
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x9003] = "2026:05:01 12:00:00"
    exif.get_ifd(0x8825).update({1: letter, 2: (33.0, 30.0, 0.0), 3: "E", 4: (151.0, 0.0, 0.0)})
    Image.fromarray(PICTURE).save(tmp_path / "a.jpg", exif=exif)
    assert tags_of(tmp_path / "a.jpg").values["latitude"] == pytest.approx(-33.5)
