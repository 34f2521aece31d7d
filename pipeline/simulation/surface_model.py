"""The scene's surface as a survey would deliver it: a GeoTIFF in UTM."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import rasterio
from pyproj import Transformer
from rasterio.transform import from_origin

from pipeline.config.scenario import SurfaceModel
from pipeline.geo.frame import LocalFrame
from pipeline.messages import FloatArray
from pipeline.simulation.scene import Scene

_BLOCK_ROWS = 256


def utm_epsg(latitude_deg: float, longitude_deg: float) -> int:
    """The EPSG code of the UTM zone (WGS84) of a position, the exceptions about Norway left aside."""
    zone = min(math.floor((longitude_deg + 180.0) / 6.0) + 1, 60)
    return (32600 if latitude_deg >= 0.0 else 32700) + zone


def write_surface_model(path: Path, scene: Scene, frame: LocalFrame, model: SurfaceModel) -> None:
    """Heights above the ellipsoid, float32, of the highest surface at each cell's centre."""
    epsg = utm_epsg(frame.origin_latitude_deg, frame.origin_longitude_deg)
    to_local = Transformer.from_crs(f"EPSG:{epsg}", frame.crs, always_xy=True)
    west, south, east, north = _bounds(to_local, scene, model)
    columns, rows = round((east - west) / model.cell), round((north - south) / model.cell)
    x = np.asarray(west + (np.arange(columns) + 0.5) * model.cell, dtype=np.float64)
    y = np.asarray(north - (np.arange(rows) + 0.5) * model.cell, dtype=np.float64)
    heights = np.concatenate(
        [_heights(to_local, scene, x, y[i : i + _BLOCK_ROWS]) for i in range(0, rows, _BLOCK_ROWS)]
    )
    with rasterio.open(
        path, "w", driver="GTiff", width=columns, height=rows, count=1, dtype="float32", crs=f"EPSG:{epsg}",
        transform=from_origin(west, north, model.cell, model.cell), nodata=np.nan,
        compress="deflate", predictor=3,
    ) as file:  # fmt: skip
        file.write(heights.astype(np.float32), 1)
        file.set_band_description(1, "surface height above the WGS84 ellipsoid, metres")


def _bounds(to_local: Transformer, scene: Scene, model: SurfaceModel) -> tuple[float, float, float, float]:
    """West, south, east, north in UTM around the area and its margin, on whole metres."""
    half_x, half_y = 0.5 * scene.extent.width_m + model.margin, 0.5 * scene.extent.depth_m + model.margin
    bounds = to_local.transform_bounds(-half_x, -half_y, half_x, half_y, direction="INVERSE")
    west, south = math.floor(bounds[0]), math.floor(bounds[1])
    columns, rows = (math.ceil((bounds[i + 2] - low) / model.cell) for i, low in enumerate((west, south)))
    return west, south, west + columns * model.cell, south + rows * model.cell


def _heights(to_local: Transformer, scene: Scene, x: FloatArray, y: FloatArray) -> FloatArray:
    grid_x, grid_y = np.meshgrid(x, y)
    east, north = to_local.transform(grid_x.ravel(), grid_y.ravel())
    return scene.surface_height(np.asarray(east), np.asarray(north)).reshape(len(y), len(x))
