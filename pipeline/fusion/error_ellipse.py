"""The ellipse in which a place lies with a stated probability."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pipeline.messages import FloatArray

#: how often the true place lies inside
PROBABILITY = 0.95


@dataclass(frozen=True, eq=False)
class ErrorEllipse:
    """A horizontal error ellipse about a place.

    semi_major_m >= semi_minor_m: at PROBABILITY. orientation_deg: of the major axis, clockwise from north,
    0 <= .. < 180. covariance_m2: float64 (2, 2), east and north, square metres.
    """

    semi_major_m: float
    semi_minor_m: float
    orientation_deg: float
    covariance_m2: FloatArray

    def contains(self, offset_m: FloatArray) -> bool:
        """Whether a point, east and north (2,) of the ellipse's middle, lies inside."""
        distance2 = offset_m @ np.linalg.solve(self.covariance_m2, offset_m)
        return bool(distance2 <= chi_square_2(PROBABILITY))

    def outline(self, count: int = 48) -> FloatArray:
        """Points (count, 2) of the ellipse, east and north of its middle, metres; the last is the first."""
        turn = np.linspace(0.0, 2.0 * math.pi, count)
        along, across = self.semi_major_m * np.cos(turn), self.semi_minor_m * np.sin(turn)
        sine, cosine = (
            math.sin(math.radians(self.orientation_deg)),
            math.cos(math.radians(self.orientation_deg)),
        )
        return np.stack([sine * along + cosine * across, cosine * along - sine * across], axis=1)


def ellipse_of(covariance_m2: FloatArray) -> ErrorEllipse:
    """The ellipse of a covariance (2, 2) of east and north, symmetric and positive definite."""
    variances, axes = np.linalg.eigh(covariance_m2)
    minor, major = np.sqrt(variances * chi_square_2(PROBABILITY))
    orientation = math.degrees(math.atan2(axes[0, 1], axes[1, 1])) % 180.0
    return ErrorEllipse(float(major), float(minor), orientation, covariance_m2)


def chi_square_2(probability: float) -> float:
    """The quantile of the chi-square distribution of two degrees of freedom (its closed form)."""
    return -2.0 * math.log(1.0 - probability)
