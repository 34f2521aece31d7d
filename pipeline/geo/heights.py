"""What the heights of a map count from, and what they are above the ellipsoid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pipeline.geo.geoid import undulation_m


@dataclass(frozen=True)
class Heights:
    """datum: what the heights of the map count from; None: nobody says it, it was assumed."""

    datum: Literal["ellipsoid", "geoid"] | None = None

    @property
    def name(self) -> str:
        """For people."""
        return self.datum or "not known"

    def ellipsoidal_m(self, height_m: float, latitude_deg: float, longitude_deg: float) -> float | None:
        """A height of the map above WGS84's ellipsoid, as GeoJSON's heights are (RFC 7946, 4); None: not known."""
        if self.datum is None:
            return None
        if self.datum == "ellipsoid":
            return height_m
        return height_m + undulation_m(latitude_deg, longitude_deg)[0]


#: nobody says what heights count from
UNKNOWN = Heights()
