"""Latitude and longitude taken for each other: far from the surface model as they are, on it the other way round."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.surface_model import bounds_m, center_wgs84
from pipeline.ingest.track import Track
from pipeline.messages import FloatArray

#: a flight begins no farther from its surface model than this, metres
_NEAR_M = 2000.0
_EXPECTED = "the two the other way round: telemetry.gps_order for subtitles with GPS(..), telemetry.columns for a table"


def require_axes_in_order(where: object, track: Track, surface_models: Sequence[Path]) -> None:
    """Raises InputError if no position is near any surface model, and most would be with the axes exchanged."""
    known = np.isfinite(track.latitude_deg) & np.isfinite(track.longitude_deg)
    latitude, longitude = track.latitude_deg[known], track.longitude_deg[known]
    # what would be a longitude cannot be a latitude
    if not len(latitude) or not surface_models or np.abs(longitude).max() > 90.0:
        return
    as_told, exchanged = np.zeros(len(latitude), np.bool_), np.zeros(len(latitude), np.bool_)
    for path in surface_models:
        as_told |= _near(path, latitude, longitude)
        exchanged |= _near(path, longitude, latitude)
    if as_told.any() or exchanged.mean() <= 0.5:
        return
    found = (
        f"positions such as latitude {latitude[0]:.5f}, longitude {longitude[0]:.5f}, far from the surface model; "
        "with latitude and longitude exchanged they lie on it"
    )
    raise InputError(where, found, _EXPECTED)


def _near(path: Path, latitude_deg: FloatArray, longitude_deg: FloatArray) -> NDArray[np.bool_]:
    """Whether each position lies on a surface model or near it."""
    middle = center_wgs84(path)
    # a map frame reaches no farther than some degrees
    away = np.abs(np.mod(longitude_deg - middle[1] + 180.0, 360.0) - 180.0)
    close = (np.abs(latitude_deg - middle[0]) < 3.0) & (away < 3.0 / max(0.05, np.cos(np.radians(middle[0]))))
    near = np.zeros(len(latitude_deg), np.bool_)
    if close.any():
        frame = LocalFrame(*middle)
        west, south, east, north = bounds_m(path, frame)
        x, y = frame.enu_from_wgs84(latitude_deg[close], longitude_deg[close])
        near[close] = (
            (x > west - _NEAR_M) & (x < east + _NEAR_M) & (y > south - _NEAR_M) & (y < north + _NEAR_M)
        )
    return near
