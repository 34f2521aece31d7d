"""Which ground is worth a second look, and how it would be flown."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from pipeline.config.base import Strict
from pipeline.config.units import (
    Fraction,
    MetersPerSecond,
    NonNegativePixels,
    PositiveMeters,
    PositiveSeconds,
)

DjiModel = Literal["M300", "M350", "M30", "M30T", "M3E", "M3T", "M3M", "M3D", "M3TD"]


class SecondLook(Strict):
    """Which ground is worth a second look, and how a drone would look at it."""

    pod_min: Fraction = 0.5
    """Ground where a person would have been found with less probability was seen badly."""
    resolution_min: NonNegativePixels = 20.0
    """Ground where a person is smaller was seen badly; pixels per person."""
    looks_min: int = Field(default=1, ge=0)
    """Ground that was looked at less often was seen badly."""
    unresolved_from: Fraction = 0.3
    """A probability from there to the threshold is undecided, after `unresolved_looks`."""
    unresolved_looks: int = Field(default=5, ge=1)
    """Observations that make a place undecided."""
    min_area: float = Field(default=6.0, gt=0.0)
    """Smaller areas are left out; square metres."""
    merge_distance: PositiveMeters = 2.0
    """Areas closer than that are made one, before small ones are left out."""
    ways_width_min: PositiveMeters = 10.0
    """Without a search area the ground that the drones' ways enclose is judged, unless it is narrower than this."""
    height: PositiveMeters = 12.0
    """Of the proposed flight, above the surface."""
    dji_model: DjiModel = "M3T"
    """The drone that `second_flight.kmz` is for; DJI Pilot 2 refuses a route for another one."""
    speed: MetersPerSecond = 3.0
    """Of the proposed flight."""
    overlap: float = Field(default=0.3, ge=0.0, le=0.9)
    """Of neighbouring strips, as a share."""
    hover: PositiveSeconds = 4.0
    """Over an undecided place."""
