import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain

angle = st.floats(-2.0 * math.pi, 2.0 * math.pi)


@given(angle, st.floats(-math.pi / 2.0, math.pi / 2.0), angle)
def test_every_attitude_is_a_rotation(yaw, pitch, roll):
    rotation = enu_from_camera(yaw, pitch, roll)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) > 0.0
    assert math.isclose(rotation[2, 2], math.sin(pitch), abs_tol=1e-12)


@given(st.floats(-0.3, 0.3), st.floats(-0.005, 0.005), st.floats(0.0, 1024.0), st.floats(0.0, 576.0))
def test_a_pixels_ray_projects_to_the_pixel(k1, p, u, v):
    camera = Camera(1024, 576, 900.0, 900.0, 512.0, 288.0, np.array([k1, 0.0, p, -p, 0.0]))
    pixel = np.array([[u, v]])
    np.testing.assert_allclose(camera.project(camera.rays(pixel)), pixel, atol=0.01)


@given(st.floats(-80.0, 80.0), st.floats(-180.0, 180.0), st.floats(-5e3, 5e3), st.floats(-5e3, 5e3))
def test_wgs84_is_the_inverse_of_the_map_frame(latitude_deg, longitude_deg, east_m, north_m):
    frame = LocalFrame(latitude_deg, longitude_deg)
    position = frame.wgs84_from_enu(np.array(east_m), np.array(north_m))
    np.testing.assert_allclose(frame.enu_from_wgs84(*position), [east_m, north_m], atol=1e-6)


@given(st.integers(0, 2**32 - 1), st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.floats(-0.9, 0.9))
def test_a_ray_ends_on_the_surface_and_passes_nothing_before(seed, east, north, lean):
    heights = np.random.default_rng(seed).uniform(0.0, 2.0, (24, 24)).astype(np.float32)
    terrain = Terrain(LocalFrame(0.0, 0.0), -6.0, -6.0, 0.5, heights)
    origin = np.array([east, north, 5.0])
    direction = np.array([lean, 0.3 * lean, -1.0]) / np.linalg.norm([lean, 0.3 * lean, -1.0])
    hit = terrain.intersect(origin, direction, 30.0)
    if hit is None:  # left the terrain on the way
        assert np.abs(origin + 6.0 * direction)[:2].max() > 5.0
        return
    reach = float(np.linalg.norm(hit - origin))
    for share in np.linspace(0.0, 0.98, 50):
        point = origin + share * reach * direction
        assert point[2] > terrain.height(point[0], point[1]) - 0.15
    assert abs(hit[2] - terrain.height(hit[0], hit[1])) < 0.06
