"""Where the missing person may be, before anybody has looked: the probability of area (POA)."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

from pydantic import Field, model_validator

from pipeline.config.base import Strict, mismatch
from pipeline.config.units import Fraction, PositiveMeters, Radians


class Point(Strict):
    """WGS84."""

    latitude: Radians
    """Of the point. Example: `{degrees: 58.4021}`."""
    longitude: Radians
    """Of the point. Example: `{degrees: 15.5752}`."""


class Ring(Strict):
    """How many of those who were lost in such a way were found within a distance."""

    within: PositiveMeters
    """Distance from the last known point. Example: `{meters: 800}`."""
    probability: Fraction
    """Share of those who were found nearer than that, all inner rings included. Example: `0.5`."""


class Prior(Strict):
    """Where the person may be, before anybody has looked: a file, or a last known point with rings about it."""

    file: Path | None = None
    """A GeoTIFF of weights (of its first band; any CRS), or GeoJSON polygons with a property `weight` each. Weights are
    shares: only their ratios matter. Example: `poa.tif`.
    """
    inside: Fraction = 1.0
    """The probability that the person is on the ground of the file at all."""
    last_known_point: Point | None = None
    """In place of a file. Example: `{latitude: {degrees: 58.4021}, longitude: {degrees: 15.5752}}`."""
    rings: tuple[Ring, ...] = Field(default=())
    """About that point, by rising distance. What the outermost leaves is elsewhere. Example: `[{within: {meters: 300},
    probability: 0.25}, {within: {meters: 800}, probability: 0.5}]`.
    """

    @model_validator(mode="after")
    def _one_kind(self) -> Prior:
        if (self.file is None) == (self.last_known_point is None):
            found = "neither" if self.file is None else "both"
            raise mismatch(found, "file, or last_known_point with rings")
        if (self.last_known_point is None) != (not self.rings):
            raise mismatch("one without the other", "last_known_point and rings", ("rings",))
        if self.file is None and "inside" in self.model_fields_set:
            raise mismatch("inside beside rings", "rings whose last probability says it", ("inside",))
        for number, (inner, outer) in enumerate(pairwise(self.rings), start=1):
            if outer.within <= inner.within or outer.probability < inner.probability:
                found = f"{outer.within:g} m, {outer.probability:g} after {inner.within:g} m, {inner.probability:g}"
                raise mismatch(found, "distances and probabilities that rise", ("rings", number))
        if self.rings and not self.rings[-1].probability:
            raise mismatch("rings of no probability", "more than 0 in the last one", ("rings",))
        return self
