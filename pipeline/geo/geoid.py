"""The height of the geoid above the WGS84 ellipsoid: h (ellipsoid) = H (geoid) + N (undulation).

Through PROJ's grid of EGM2008 where the machine has one, else EGM96 in a grid of a quarter of a degree, cubic between
its points (0.5 cm rms, 8 cm at most, against EGM96's own grid of 5 minutes). EGM96 is good to 0.5 to 1 m
(F. G. Lemoine et al., "The Development of the Joint NASA GSFC and NIMA Geopotential Model EGM96", NASA TP-1998-206861).
"""

from __future__ import annotations

import math
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio.errors import NotGeoreferencedWarning
from scipy.ndimage import map_coordinates

#: what each model may be off by, standard deviations, metres
_EGM2008_SD_M, _EGM96_SD_M = 0.3, 0.7
_STEP_DEG = 0.25
#: points about a place from which the cubic spline is made
_HALF_PATCH = 12


def undulation_m(latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """Height of the geoid above the ellipsoid at a place, and its standard deviation, metres."""
    by_proj = _by_proj(latitude_deg, longitude_deg)
    if by_proj is not None:
        return by_proj, _EGM2008_SD_M
    return _by_egm96(latitude_deg, longitude_deg), _EGM96_SD_M


def _by_egm96(latitude_deg: float, longitude_deg: float) -> float:
    grid = _egm96_cm()
    row, column = (90.0 - latitude_deg) / _STEP_DEG, (longitude_deg % 360.0) / _STEP_DEG
    rows = np.clip(
        np.arange(math.floor(row) - _HALF_PATCH, math.floor(row) + _HALF_PATCH), 0, grid.shape[0] - 1
    )
    columns = np.arange(math.floor(column) - _HALF_PATCH, math.floor(column) + _HALF_PATCH)
    patch = grid[np.ix_(rows, columns % grid.shape[1])].astype(np.float64)
    place = [[row - math.floor(row) + _HALF_PATCH], [column - math.floor(column) + _HALF_PATCH]]
    return 0.01 * float(map_coordinates(patch, place, order=3, mode="nearest")[0])


@cache
def _egm96_cm() -> NDArray[np.int16]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(Path(__file__).with_name("egm96-15.tif")) as source:
            return np.asarray(source.read(1), dtype=np.int16)


def _by_proj(latitude_deg: float, longitude_deg: float) -> float | None:
    """By PROJ's grid of EGM2008, None where the machine has none."""
    transform = _egm2008()
    if transform is None:
        return None
    _, _, height_m = transform.transform(longitude_deg, latitude_deg, 0.0)
    return -float(height_m) if math.isfinite(height_m) else None


@cache
def _egm2008():  # type: ignore[no-untyped-def]
    from pyproj.transformer import TransformerGroup

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that a grid is missing is what is asked here
        group = TransformerGroup("EPSG:4979", "EPSG:9518", always_xy=True, allow_ballpark=False)
    return group.transformers[0] if group.best_available and group.transformers else None
