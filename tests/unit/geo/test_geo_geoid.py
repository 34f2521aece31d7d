"""The undulation is the published one, wherever the mission is."""

import numpy as np
import pytest

from pipeline.geo.geoid import _by_egm96, undulation_m

# NGA's own test points of EGM96 (INPUT.DAT and OUTINTPT.DAT of its distribution): latitude, longitude, metres
PUBLISHED = [
    (38.6281550, 269.7791550, -31.628),
    (-14.6212170, 305.0211140, -2.969),
    (46.8743190, 102.4487290, -43.575),
    (-23.6174460, 133.8747120, 15.871),
    (38.6254730, 359.9995000, 50.066),
    (-0.4667440, 0.0023000, 17.329),
]


@pytest.mark.parametrize(("latitude", "longitude", "metres"), PUBLISHED)
def test_it_is_what_its_makers_print(latitude: float, longitude: float, metres: float) -> None:
    assert _by_egm96(latitude, longitude) == pytest.approx(metres, abs=0.08)


@pytest.mark.parametrize("latitude", [-89.99, -45.0, 0.0, 60.0, 90.0])
def test_it_has_no_step_at_the_antimeridian_or_the_prime_meridian(latitude: float) -> None:
    for meridian in (0.0, 180.0):
        assert _by_egm96(latitude, meridian - 1e-6) == pytest.approx(
            _by_egm96(latitude, meridian + 1e-6), abs=1e-3
        )
    assert _by_egm96(latitude, -170.0) == _by_egm96(latitude, 190.0)


def test_it_comes_with_its_error() -> None:
    value, sd = undulation_m(58.4, 15.57)
    assert 25.0 < value < 33.0
    assert 0.1 < sd < 1.5


def test_it_is_smooth() -> None:
    values = np.array([_by_egm96(47.0, 8.0 + 0.01 * k) for k in range(100)])
    assert np.abs(np.diff(values, 2)).max() < 0.01
