"""The mission's local map frame.

x east, y north (a transverse Mercator on WGS84 with its origin at the mission and k_0 = 1), z the height
above the terrain's datum. Within 5 km of the origin its scale is true to 4e-7, and its axes are east and
north.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from pyproj import CRS, Transformer

from pipeline.messages import FloatArray


@dataclass(frozen=True)
class LocalFrame:
    """origin_latitude_deg, origin_longitude_deg: WGS84."""

    origin_latitude_deg: float
    origin_longitude_deg: float

    @cached_property
    def crs(self) -> CRS:
        """The horizontal CRS of the frame."""
        return CRS.from_proj4(
            f"+proj=tmerc +lat_0={self.origin_latitude_deg!r} +lon_0={self.origin_longitude_deg!r} "
            "+k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs +type=crs"
        )

    @cached_property
    def _to_local(self) -> Transformer:
        return Transformer.from_crs("EPSG:4326", self.crs, always_xy=True)

    def enu_from_wgs84(
        self, latitude_deg: FloatArray, longitude_deg: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """East and north, metres, of WGS84 positions, degrees; scalars or arrays of one shape."""
        east, north = self._to_local.transform(longitude_deg, latitude_deg)
        return np.asarray(east, dtype=np.float64), np.asarray(north, dtype=np.float64)

    def wgs84_from_enu(self, east_m: FloatArray, north_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Latitude and longitude, degrees: the inverse of enu_from_wgs84."""
        longitude, latitude = self._to_local.transform(east_m, north_m, direction="INVERSE")
        return np.asarray(latitude, dtype=np.float64), np.asarray(longitude, dtype=np.float64)
