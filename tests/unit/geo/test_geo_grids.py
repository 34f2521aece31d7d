import numpy as np
import pytest
from pyproj import Proj

from pipeline.geo.grids import mgrs_of, utm_of


@pytest.mark.parametrize(
    ("latitude", "longitude", "square"),
    [
        (58.40189827, 15.57552593, "33V WE"),
        (38.8976763, -77.0365298, "18S UJ"),
        (-33.8568, 151.2153, "56H LH"),
    ],
)
def test_a_square_of_100_km_has_its_letters(latitude: float, longitude: float, square: str) -> None:
    assert mgrs_of(latitude, longitude, 0) == square
    assert mgrs_of(latitude, longitude).startswith(f"{square} ")


@pytest.mark.parametrize(
    ("latitude", "longitude", "zone"),
    [
        (60.5, 5.0, 32),
        (60.5, 2.9, 31),
        (78.2, 15.6, 33),
        (78.2, 8.9, 31),
        (0.0, 0.0, 31),
        (-80.0, 179.99, 60),
    ],
)
def test_utm_is_in_the_zone_of_mgrs_and_agrees_with_it(latitude: float, longitude: float, zone: int) -> None:
    utm = utm_of(latitude, longitude)
    assert utm is not None
    assert utm.zone == zone
    easting, northing = Proj(proj="utm", zone=zone, ellps="WGS84", south=latitude < 0)(longitude, latitude)
    assert (utm.easting_m, utm.northing_m) == pytest.approx((easting, northing), abs=1e-3)
    digits = mgrs_of(latitude, longitude).split()
    assert digits[0] == f"{zone}{utm.band}"
    for value, five in zip((utm.easting_m, utm.northing_m), digits[2:], strict=True):
        apart = (value - int(five)) % 100_000
        assert min(apart, 100_000 - apart) <= 1.5


def test_a_polar_grid_has_no_utm() -> None:
    assert utm_of(89.0, 10.0) is None
    assert utm_of(-85.0, 10.0) is None
    assert mgrs_of(89.0, 10.0) == "Z AF 19279 90660"


def test_a_coarser_square_holds_the_finer_one() -> None:
    rng = np.random.default_rng(3)
    for latitude, longitude in zip(rng.uniform(-79, 83, 50), rng.uniform(-180, 180, 50), strict=True):
        fine, coarse = (mgrs_of(latitude, longitude, digits).split() for digits in (5, 2))
        assert coarse == [*fine[:2], fine[2][:2], fine[3][:2]]
