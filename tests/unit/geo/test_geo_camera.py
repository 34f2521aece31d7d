import numpy as np
import pytest

from pipeline.geo.camera import Camera
from pipeline.geo.pose import enu_from_camera
from pipeline.messages import CameraPose

CAMERA = Camera(1024, 576, 900.0, 950.0, 500.0, 300.0)
BENT = Camera(1024, 576, 900.0, 950.0, 500.0, 300.0, np.array([-0.1, 0.01, 0.002, -0.003, 0.001]))


def test_a_point_projects_where_the_pinhole_says():
    np.testing.assert_allclose(
        CAMERA.project(np.array([[1.0, -2.0, 10.0], [0.0, 0.0, 5.0]])), [[590.0, 110.0], [500.0, 300.0]]
    )


def test_a_point_behind_the_camera_has_no_pixel():
    assert np.isnan(CAMERA.project(np.array([[1.0, 1.0, -5.0], [1.0, 1.0, 0.0]]))).all()


def test_distortion_is_opencvs():
    # x = 0.2, y = 0.1: r2 = 0.05; worked out by hand from OpenCV's formulas
    k1, k2, p1, p2, k3 = BENT.distortion
    radial = 1.0 + k1 * 0.05 + k2 * 0.0025 + k3 * 0.000125
    x = 0.2 * radial + 2.0 * p1 * 0.02 + p2 * (0.05 + 2.0 * 0.04)
    y = 0.1 * radial + p1 * (0.05 + 2.0 * 0.01) + 2.0 * p2 * 0.02
    pixel = BENT.project(np.array([[0.2, 0.1, 1.0]]))[0]
    np.testing.assert_allclose(pixel, [900.0 * x + 500.0, 950.0 * y + 300.0])


@pytest.mark.parametrize("camera", [CAMERA, BENT])
def test_rays_in_the_map_lead_back_to_their_pixels(camera):
    pose = CameraPose(np.array([3.0, -4.0, 20.0]), enu_from_camera(1.0, -0.7, 0.2))
    pixels = np.array([[0.0, 0.0], [1024.0, 576.0], [10.5, 500.0], [500.0, 300.0]])
    rays = camera.rays_enu(pixels, pose)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0)
    points = pose.position_enu + rays * np.array([[5.0], [50.0], [500.0], [1.0]])
    np.testing.assert_allclose(camera.project_enu(points, pose), pixels, atol=1e-6)


def test_the_optical_axis_is_the_ray_of_the_principal_point():
    pose = CameraPose(np.zeros(3), enu_from_camera(0.3, -0.5, 0.1))
    np.testing.assert_allclose(
        CAMERA.rays_enu(np.array([[500.0, 300.0]]), pose)[0], pose.enu_from_camera[:, 2], atol=1e-12
    )
