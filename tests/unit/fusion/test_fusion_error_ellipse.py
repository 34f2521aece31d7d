import math

import numpy as np
import pytest
from scipy.stats import chi2

from pipeline.fusion.error_ellipse import chi_square_2, ellipse_of


def rotated(major, minor, orientation_deg):
    """The covariance of standard deviations along and across an axis, clockwise from north."""
    s, c = math.sin(math.radians(orientation_deg)), math.cos(math.radians(orientation_deg))
    axes = np.array([[s, c], [c, -s]])
    return axes @ np.diag([major**2, minor**2]) @ axes.T


@pytest.mark.parametrize("orientation", [0.0, 30.0, 90.0, 135.0, 179.0])
def test_axes_and_orientation_are_those_of_the_covariance(orientation):
    ellipse = ellipse_of(rotated(2.0, 0.5, orientation))
    scale = math.sqrt(chi2.ppf(0.95, 2))
    assert ellipse.semi_major_m == pytest.approx(2.0 * scale)
    assert ellipse.semi_minor_m == pytest.approx(0.5 * scale)
    assert math.remainder(ellipse.orientation_deg - orientation, 180.0) == pytest.approx(0.0, abs=1e-6)


def test_ninety_five_of_a_hundred_draws_lie_inside():
    covariance = rotated(1.0, 0.3, 40.0)
    draws = np.random.default_rng(1).multivariate_normal([0.0, 0.0], covariance, 4000)
    inside = np.mean([ellipse_of(covariance).contains(draw) for draw in draws])
    assert inside == pytest.approx(0.95, abs=0.012)


def test_the_outline_lies_on_the_border_and_is_closed():
    covariance = rotated(1.5, 0.4, 70.0)
    outline = ellipse_of(covariance).outline()
    distance2 = np.einsum("ni,ij,nj->n", outline, np.linalg.inv(covariance), outline)
    np.testing.assert_allclose(distance2, chi_square_2(0.95), rtol=1e-9)
    np.testing.assert_allclose(outline[0], outline[-1], atol=1e-12)
