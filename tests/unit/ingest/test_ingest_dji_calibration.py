"""What DJI's drones write of their camera into stills is that camera, in OpenCV's terms."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from pipeline.config.mission import load_mission
from pipeline.geo.camera import Camera
from pipeline.ingest.cameras.dji_calibration import common_camera, dji_camera
from pipeline.ingest.telemetry.stills_metadata import camera_of, dated_stills
from pipeline.mission.recording import read_recording
from tests.stills import write_still

SIZE = (5280, 3956)
#: of a Mavic 3 Enterprise
DEWARP = (
    "2025-02-26;3713.771893164336,3713.771893164336,20.720882112011,-16.733345702852,-0.107756512758,"
    "-0.000878853880,0.000130474491,-0.000011293710,-0.015723478938"
)
DESIGN = {
    "CalibratedFocalLength": "3725.151611",
    "CalibratedOpticalCenterX": "2640.000000",
    "CalibratedOpticalCenterY": "1978.000000",
}


def camera(tags: dict[str, str], size: tuple[int, int] = SIZE) -> Camera:
    found = dji_camera(tags, *size)
    assert found is not None
    return found


def test_the_factory_s_calibration_counts_before_the_design() -> None:
    found = camera(DESIGN | {"DewarpData": DEWARP, "DewarpFlag": "0"})
    assert (found.fx, found.cx, found.cy) == pytest.approx((3713.7719, 2660.7209, 1961.2667), abs=1e-3)
    np.testing.assert_allclose(
        found.distortion, [-0.107756512758, -0.00087885388, 0.000130474491, -0.00001129371, -0.015723478938]
    )
    assert found.focal_sd == 0.003


def test_a_pixel_goes_back_to_where_opencv_s_formula_sends_its_ray() -> None:
    found = camera({"DewarpData": DEWARP})
    x, y = 0.4, -0.3
    k1, k2, p1, p2, k3 = (float(v) for v in DEWARP.split(";")[1].split(",")[4:])
    r2 = x * x + y * y
    radial = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = found.fx * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + 2640.0 + 20.720882112011
    v = found.fy * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + 1978.0 - 16.733345702852
    np.testing.assert_allclose(found.project(np.array([[x, y, 1.0]])), [[u, v]], atol=1e-6)


def test_a_picture_that_was_straightened_already_is_not_straightened_again() -> None:
    found = camera(DESIGN | {"DewarpData": DEWARP, "DewarpFlag": "1"})
    assert not found.distortion.any()
    assert found.fx == pytest.approx(3713.7719, abs=1e-3)


def test_twelve_numbers_are_the_rational_model() -> None:
    found = camera({"DewarpDataK6": "2025-01-01;3000,3010,5,-6,0.1,0.2,0.001,0.002,0.3,0.4,0.5,0.6"})
    assert (found.fx, found.fy, found.cx, found.cy) == (3000.0, 3010.0, 2645.0, 1972.0)
    assert found.distortion.tolist() == [0.1, 0.2, 0.001, 0.002, 0.3, 0.4, 0.5, 0.6]


def test_the_design_alone_is_less_sure() -> None:
    found = camera(DESIGN)
    assert (found.fx, found.cx, found.cy, found.focal_sd) == (3725.151611, 2640.0, 1978.0, 0.01)


@pytest.mark.parametrize(
    "tags",
    [
        {},
        {"DewarpData": "test-calibration"},
        {"DewarpData": "2026-09-26;1,2,3,4,nan,0.1,0.2,0.3,0.4"},
        {"DewarpData": "2026-09-26;inf,3000,0,0,0,0,0,0,0"},
        {"DewarpData": "2026-09-26;3000,3000,0,0,0,0,0"},
        {"DewarpData": "2026-09-26;-3000,3000,0,0,0,0,0,0,0"},
        {"DewarpData": "2026-09-26;3000,3000,2640,1978,0,0,0,0,0"},
        {"CalibratedFocalLength": "inf"},
        {"CalibratedFocalLength": "0.000000"},
        {"CalibratedFocalLength": "12.29"},
        DESIGN | {"CalibratedOpticalCenterX": "4000.0", "CalibratedOpticalCenterY": "3000.0"},
    ],
)
def test_tags_that_do_not_tell_or_are_of_pictures_of_another_size_tell_nothing(tags: dict[str, str]) -> None:
    assert dji_camera(tags, *SIZE) is None
    assert dji_camera(tags, 0, 0) is None


def test_stills_of_different_lenses_have_no_common_camera() -> None:
    wide, tele = camera(DESIGN), camera({"CalibratedFocalLength": "25000"})
    again = camera({"CalibratedFocalLength": "3730.0"})
    assert common_camera([wide, again]) is wide
    assert common_camera([wide, tele]) is None
    assert common_camera([wide, None]) is None
    assert common_camera([]) is None


XMP = {
    "AbsoluteAltitude": "+131.25", "RelativeAltitude": "+20.50", "GimbalYawDegree": "-35.5",
    "GimbalPitchDegree": "-80.0", "GimbalRollDegree": "+0.0",
}  # fmt: skip


def folder_of(folder: Path, xmp: dict[str, str]) -> Path:
    folder.mkdir(exist_ok=True)
    for k in range(3):
        taken = datetime(2026, 5, 1, 12, 0, 2 * k)
        image = np.zeros((48, 64, 3), np.uint8)
        write_still(
            folder / f"DJI_{k}.JPG",
            image,
            taken + timedelta(0),
            58.4021,
            15.5752 + 1e-5 * k,
            140.0,
            XMP | xmp,
        )
    return folder


SMALL = "2026-01-01;60.0,61.0,1.0,-0.5,-0.05,0.01,0.001,-0.002,0.0"


def test_a_folder_of_stills_has_the_camera_of_its_files(tmp_path: Path) -> None:
    stills, _ = dated_stills(folder_of(tmp_path, {"DewarpData": SMALL}))
    found = camera_of(stills)
    assert found is not None
    assert (found.width, found.height, found.fx, found.fy, found.cx, found.cy) == (
        64,
        48,
        60.0,
        61.0,
        33.0,
        23.5,
    )
    write_still(
        tmp_path / "Z.JPG", np.zeros((48, 64, 3), np.uint8), datetime(2026, 5, 1, 13), 58.0, 15.0, 1.0, XMP
    )
    assert camera_of(dated_stills(tmp_path)[0]) is None


@pytest.mark.parametrize("xmp", [{"DewarpData": SMALL}, {}])
def test_a_stream_of_stills_uses_it_before_the_list_and_the_equivalent_focal_length(
    small_mission: Path, tmp_path: Path, xmp: dict[str, str]
) -> None:
    mission = load_mission(small_mission)
    folder = folder_of(tmp_path / "stills", xmp)
    telemetry = mission.streams[0].telemetry.model_copy(
        update={"file": folder, "format": "auto", "utc_offset": None}
    )
    of_metadata = mission.streams[0].camera.model_copy(update={"file": None})
    stream = mission.streams[0].model_copy(
        update={"video": None, "stills": folder, "telemetry": telemetry, "camera": of_metadata}
    )
    recording = read_recording(small_mission, mission, stream)
    if xmp:
        assert recording.camera.fx == 60.0
        assert recording.camera.focal_sd == 0.003
        assert "as its metadata say, good to 0.3%" in recording.chosen.assumed[0]
    else:
        assert "a DJI Air 2S, known by its name" in recording.chosen.assumed[0]  # FC3411, 24 mm in EXIF
    assert recording.chosen.focal_length_35mm == 24.0 if xmp else 22.0
