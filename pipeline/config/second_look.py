"""Which ground is worth a second look, and how it would be flown."""

from __future__ import annotations

from pydantic import Field

from pipeline.config.base import Strict
from pipeline.config.units import (
    Fraction,
    MetersPerSecond,
    NonNegativePixels,
    PositiveMeters,
    PositiveSeconds,
)


class SecondLook(Strict):
    """Which ground is worth a second look, and how a drone would look at it.

    pod_min, resolution_min (pixels per person), looks_min: seen worse than that is seen badly.
    unresolved_from: a probability from there to the threshold is undecided, if there were unresolved_looks
    observations at least. min_area (square metres): smaller areas are left out, after those closer than
    merge_distance have been made one. height (above the surface), speed, overlap (of neighbouring strips,
    0..0.9), hover: of the proposed flight.
    """

    pod_min: Fraction = 0.5
    resolution_min: NonNegativePixels = 20.0
    looks_min: int = Field(default=1, ge=0)
    unresolved_from: Fraction = 0.3
    unresolved_looks: int = Field(default=5, ge=1)
    min_area: float = Field(default=6.0, gt=0.0)
    merge_distance: PositiveMeters = 2.0
    height: PositiveMeters = 12.0
    speed: MetersPerSecond = 3.0
    overlap: float = Field(default=0.3, ge=0.0, le=0.9)
    hover: PositiveSeconds = 4.0
