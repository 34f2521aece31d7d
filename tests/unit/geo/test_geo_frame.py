import numpy as np
import pytest
from pyproj import Geod

from pipeline.geo.frame import LocalFrame


@pytest.mark.parametrize("latitude_deg", [0.0, 47.0, -33.9, 69.6])
@pytest.mark.parametrize("azimuth_deg", [0.0, 45.0, 90.0, 200.0])
def test_east_and_north_are_those_of_the_geodesic(latitude_deg, azimuth_deg):
    frame = LocalFrame(latitude_deg, 15.6)
    longitude, latitude, _ = Geod(ellps="WGS84").fwd(15.6, latitude_deg, azimuth_deg, 1000.0)
    east, north = frame.enu_from_wgs84(np.array(latitude), np.array(longitude))
    azimuth = np.radians(azimuth_deg)
    np.testing.assert_allclose([east, north], [1000.0 * np.sin(azimuth), 1000.0 * np.cos(azimuth)], atol=0.01)


def test_the_scale_five_kilometres_out_is_as_stated():
    frame = LocalFrame(47.0, 8.0)
    latitude, longitude = frame.wgs84_from_enu(np.array([5000.0, 5000.0]), np.array([0.0, 100.0]))
    _, _, length = Geod(ellps="WGS84").inv(longitude[0], latitude[0], longitude[1], latitude[1])
    assert length == pytest.approx(100.0, rel=4e-7)


def test_the_origin_is_zero():
    frame = LocalFrame(47.0, 8.0)
    np.testing.assert_allclose(frame.enu_from_wgs84(np.array(47.0), np.array(8.0)), 0.0, atol=1e-9)
