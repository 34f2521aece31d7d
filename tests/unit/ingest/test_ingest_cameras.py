"""The camera is what the mission, a calibration file or the metadata say, or it is asked for."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.config.camera import CameraSource
from pipeline.errors import InputError
from pipeline.geo.camera import Camera
from pipeline.ingest.cameras.calibration_file import read_calibration
from pipeline.ingest.cameras.choice import ChosenCamera, PictureFacts, choose_camera

OWN = "width: 1920\nheight: 1080\nfx: 1500\nfy: 1500\ncx: 960\ncy: 540\n"
OPENCV = """%YAML:1.0
---
image_width: 1920
image_height: 1080
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [1500., 0., 959.5, 0., 1500., 539.5, 0., 0., 1.]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [-0.05, 0.01, 0.001, -0.002, 0.0]
"""
XML = """<?xml version="1.0"?><opencv_storage><image_Width>1920</image_Width><image_Height>1080</image_Height>
<Camera_Matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
<data>1500 0 959.5 0 1500 539.5 0 0 1</data></Camera_Matrix>
<Distortion_Coefficients type_id="opencv-matrix"><rows>5</rows><cols>1</cols><dt>d</dt>
<data>-0.05 0.01 0.001 -0.002 0</data>
</Distortion_Coefficients></opencv_storage>"""
ROS = """image_width: 1920
image_height: 1080
camera_name: head
camera_matrix: {rows: 3, cols: 3, data: [1500, 0, 959.5, 0, 1500, 539.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.05, 0.01, 0.001, -0.002, 0]}
"""


def chosen(width: int = 1920, height: int = 1080, focal_mm: float = 0.0, **given: object) -> ChosenCamera:
    source = CameraSource.model_validate(given)
    return choose_camera(source, PictureFacts(width, height, "mission.yaml streams.a", (), None, focal_mm))


def calibration(folder: Path, text: str, name: str = "camera.yaml") -> Camera:
    (folder / name).write_text(text, encoding="utf-8")
    return read_calibration(folder / name).camera


def test_calibrations_of_other_tools_are_read_to_the_same_camera(tmp_path: Path) -> None:
    for text, name in ((OPENCV, "a.yml"), (XML, "a.xml"), (ROS, "a.yaml")):
        camera = calibration(tmp_path, text, name)
        assert (camera.width, camera.height, camera.fx, camera.cx, camera.cy) == (
            1920,
            1080,
            1500.0,
            960.0,
            540.0,
        )
        np.testing.assert_allclose(camera.distortion, [-0.05, 0.01, 0.001, -0.002, 0.0])


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (ROS.replace("plumb_bob", "equidistant"), "the lens model 'equidistant'"),
        (ROS.replace("-0.002, 0]", "-0.002, 0, 1, 1, 1, 2, 2, 2, 2]"), "12 coefficients"),
        (ROS.replace("1500, 0, 959.5", "1500, 0"), "8 numbers"),
        (ROS.replace("[1500, 0", "[-1500, 0"), "camera_matrix"),
        (OWN.replace("fx: 1500", "fx: 0"), "fx"),
        ("camera_matrix: [", "not YAML"),
        ("<x", "not XML"),
        ("<!DOCTYPE a><a/>", "document type"),
    ],
)
def test_a_calibration_that_is_none_is_one_line(tmp_path: Path, text: str, found: str) -> None:
    with pytest.raises(InputError, match=found):
        calibration(tmp_path, text)


def test_fields_of_view_and_equivalent_focal_lengths_are_the_same_camera_said_otherwise() -> None:
    across = chosen(field_of_view={"degrees": 65.2, "of": "horizontal"}).camera
    f = 960.0 / math.tan(math.radians(32.6))
    assert across.fx == pytest.approx(f)
    down = 2.0 * math.degrees(math.atan(540.0 / f))
    corner = 2.0 * math.degrees(math.atan(math.hypot(960.0, 540.0) / f))
    assert chosen(field_of_view={"degrees": down, "of": "vertical"}).camera.fx == pytest.approx(f)
    assert chosen(field_of_view={"degrees": corner, "of": "diagonal"}).camera.fx == pytest.approx(f)
    equivalent_mm = f / math.hypot(1920, 1080) * math.hypot(36.0, 24.0)
    assert chosen(equivalent_focal_length={"millimeters": equivalent_mm}).camera.fx == pytest.approx(f)
    assert chosen(
        equivalent_focal_length={"millimeters": 36.0, "of": "horizontal"}
    ).camera.fx == pytest.approx(1920.0)


def test_what_is_not_calibrated_is_less_sure_and_says_so() -> None:
    calibrated = {"width": 1920, "height": 1080, "fx": 1500, "fy": 1500, "cx": 960, "cy": 540}
    assert chosen(intrinsics=calibrated).camera.focal_sd == 0.0
    assert chosen(field_of_view={"degrees": 65.2, "of": "horizontal"}).camera.focal_sd == 0.02
    by_metadata = chosen(focal_mm=24.0)
    assert by_metadata.camera.focal_sd == 0.10
    assert "a video shows a part of the sensor" in by_metadata.assumed[0]
    assert by_metadata.focal_length_35mm == 24.0


def test_a_calibration_of_another_size_is_scaled_where_the_shape_agrees_and_refused_otherwise(
    tmp_path: Path,
) -> None:
    (tmp_path / "c.yaml").write_text(OWN, encoding="utf-8")
    scaled = chosen(960, 540, file=tmp_path / "c.yaml")
    assert (scaled.camera.fx, scaled.camera.cx, scaled.camera.width) == (750.0, 480.0, 960)
    assert "scaled to 960 x 540" in scaled.assumed[0]
    with pytest.raises(InputError, match="the size of the pictures, 640 x 512, or its shape"):
        chosen(640, 512, file=tmp_path / "c.yaml")


def test_a_camera_that_nobody_tells_is_asked_for_with_the_ways_to_say_it() -> None:
    with pytest.raises(
        InputError, match=r"no focal length in the metadata; expected camera: FILE .*field_of_view"
    ):
        chosen()


def test_a_lens_model_that_folds_inside_the_picture_is_refused_with_the_radius() -> None:
    folding = {
        "width": 800,
        "height": 600,
        "fx": 450,
        "fy": 450,
        "cx": 400,
        "cy": 300,
        "distortion": [-0.3, 0, 0, 0, 0],
    }
    with pytest.raises(InputError, match=r"folds 3\d\d pixels from the principal point"):
        chosen(800, 600, intrinsics=folding)


@pytest.mark.parametrize(
    "given",
    [
        {"field_of_view": {"degrees": 70}},
        {"field_of_view": {"degrees": 70, "of": "diagonal"}, "file": "a.yaml"},
    ],
)
def test_half_said_and_twice_said_cameras_are_refused(given: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="mismatch"):
        CameraSource.model_validate(given)


@given(
    st.floats(-0.12, 0.12), st.floats(-0.02, 0.05), st.floats(-0.003, 0.003), st.floats(-0.003, 0.003),
    st.floats(0.0, 1.0), st.floats(0.0, 1.0),
)  # fmt: skip
def test_a_ray_projects_to_the_pixel_that_it_came_from(
    k1: float, k2: float, p1: float, p2: float, x: float, y: float
) -> None:
    camera = Camera(1920, 1080, 1500.0, 1500.0, 960.0, 540.0, np.array([k1, k2, p1, p2, 0.0]))
    pixels = np.array([[1920.0 * x, 1080.0 * y]])
    rays = camera.rays(pixels)
    if np.isfinite(rays).all():
        np.testing.assert_allclose(camera.project(rays), pixels, atol=1e-6)
    else:  # only where the model folds
        assert k1 < 0.0 or k2 < 0.0


def test_zooming_is_a_longer_focal_length_and_scale_one_is_the_camera_itself() -> None:
    camera = Camera(1920, 1080, 900.0, 900.0, 960.0, 540.0)
    assert camera.zoomed(1.0) is camera
    assert camera.zoomed(2.0).fx == 1800.0


@pytest.mark.parametrize(
    ("matrix", "found"),
    [
        ("[[8.8, 0, 6.4], [0, 8.8, 3.6], [0, 0, 1]]", "a focal length of 8.8 pixels"),
        ("[[0.7, 0, 0.5], [0, 1.25, 0.5], [0, 0, 1]]", "a focal length of 0.7 pixels"),
        ("[[900, 0, 6400], [0, 900, 360], [0, 0, 1]]", "a principal point at 6400.5"),
        ("[[900, 0, 0], [0, 900, 0], [0, 0, 1]]", "a principal point at 0.5, 0.5"),
        ("[[900, 0, 640], [0, 9000, 360], [0, 0, 1]]", "fx 900 and fy 9000"),
        ("[[900000, 0, 640], [0, 900000, 360], [0, 0, 1]]", "a focal length of 900000 pixels"),
    ],
)
def test_a_camera_that_no_drone_has_is_refused(tmp_path: Path, matrix: str, found: str) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(f"camera_matrix: {matrix}\nimage_width: 1280\nimage_height: 720\n", encoding="utf-8")
    with pytest.raises(InputError, match=found):
        choose_camera(
            CameraSource.model_validate({"file": path}), PictureFacts(1280, 720, "mission.yaml streams.a")
        )


def test_a_calibration_in_one_line_of_json_is_read(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    text = '{"mtx": [[900, 0, 640], [0, 910, 360], [0, 0, 1]], "dist": [[0.1, 0, 0, 0, 0]], "image_width": 1280, '
    path.write_text(text + '"image_height": 720}', encoding="utf-8")
    camera = read_calibration(path).camera
    assert (camera.width, camera.fx, camera.fy, camera.cx, camera.distortion[0]) == (
        1280,
        900,
        910,
        640.5,
        0.1,
    )
