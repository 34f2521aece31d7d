"""The grids that rescue teams read positions in: MGRS and UTM, on WGS84."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

from mgrs import MGRS
from pyproj import Transformer

_PARTS = re.compile(r"^(?P<zone>\d{0,2})(?P<band>[A-Z])(?P<square>[A-Z]{2})(?P<digits>\d*)$")
#: MGRS letters of bands from the equator to the north
_NORTHERN = "NPQRSTUVWX"


@dataclass(frozen=True)
class Utm:
    """zone: 1 to 60. band: its letter. easting_m, northing_m: in that zone; south of the equator from 10,000 km."""

    zone: int
    band: str
    easting_m: float
    northing_m: float

    @property
    def epsg(self) -> int:
        """Of the zone's coordinates."""
        return (32600 if self.band in _NORTHERN else 32700) + self.zone

    @property
    def text(self) -> str:
        """For people, to the metre."""
        return f"{self.zone}{self.band} {self.easting_m:.0f} {self.northing_m:.0f}"


def mgrs_of(latitude_deg: float, longitude_deg: float, digits: int = 5) -> str:
    """``33V WE 33636 73600``: the square of 1 m that a position lies in. digits: 5 for 1 m, 2 for 1 km, 0 for 100 km.

    Past 84 degrees north and 80 south the grid is polar and has no zone: ``Z AF 19279 90660``.
    """
    text = MGRS().toMGRS(latitude_deg, longitude_deg, MGRSPrecision=digits)
    found = _PARTS.match(text)
    assert found is not None, text
    half = len(found["digits"]) // 2
    parts = (
        f"{found['zone']}{found['band']}",
        found["square"],
        found["digits"][:half],
        found["digits"][half:],
    )
    return " ".join(part for part in parts if part)


def utm_of(latitude_deg: float, longitude_deg: float) -> Utm | None:
    """In the zone that MGRS uses there (Norway's and Svalbard's are wider); None where the grid is polar."""
    found = _PARTS.match(MGRS().toMGRS(latitude_deg, longitude_deg, MGRSPrecision=0))
    assert found is not None
    if not found["zone"]:
        return None
    zone, band = int(found["zone"]), found["band"]
    easting_m, northing_m = _to_utm(zone, band in _NORTHERN).transform(longitude_deg, latitude_deg)
    return Utm(zone, band, float(easting_m), float(northing_m))


@cache
def _to_utm(zone: int, northern: bool) -> Transformer:
    return Transformer.from_crs("EPSG:4326", f"EPSG:{(32600 if northern else 32700) + zone}", always_xy=True)
