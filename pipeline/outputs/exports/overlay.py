"""The probability layer as a picture on WGS84's degrees, to be laid over any map."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import matplotlib
import numpy as np
import rasterio
from PIL import Image
from rasterio.warp import Resampling, calculate_default_transform, reproject

from pipeline.errors import InputError
from pipeline.outputs.exports.decided_cells import Shift, decided_cells

#: of the longer side; a block of a larger map shows its greatest value
_MOST_PIXELS = 2048


@dataclass(frozen=True, eq=False)
class Overlay:
    """png: RGBA, transparent where nobody looked. north, south, east, west: of its edges, degrees."""

    png: bytes = field(repr=False)
    north: float
    south: float
    east: float
    west: float


def overlay_of(saliency: Path, shifts: Sequence[Shift] = ()) -> Overlay:
    """Of a run's ``saliency.tif``. shifts: of what was decided. Raises InputError if it cannot be read."""
    try:
        with rasterio.open(saliency) as source:
            transform, width, height = calculate_default_transform(
                source.crs, "EPSG:4326", source.width, source.height, *source.bounds
            )
            shrink = max(1.0, max(width, height) / _MOST_PIXELS)
            columns, rows = max(1, round(width / shrink)), max(1, round(height / shrink))
            transform = transform @ rasterio.Affine.scale(width / columns, height / rows)
            layer = np.full((rows, columns), np.nan, dtype=np.float32)
            reproject(
                decided_cells(source, shifts)[0] if shifts else source.read(1),
                layer,
                src_transform=source.transform,
                src_crs=source.crs,
                dst_transform=transform,
                dst_crs="EPSG:4326",
                src_nodata=np.nan,
                dst_nodata=np.nan,
                # nobody vanishes when it is drawn smaller
                resampling=Resampling.nearest if shrink == 1.0 else Resampling.max,
            )
    except rasterio.errors.RasterioIOError as error:
        raise InputError(saliency, f"a file that cannot be read ({error})"[:200], "a run's GeoTIFF") from None
    seen = np.isfinite(layer)
    colors = (255 * matplotlib.colormaps["viridis"](np.where(seen, layer, 0.0))).astype(np.uint8)
    colors[..., 3] = np.where(seen, 90 + 165 * np.clip(np.where(seen, layer, 0.0), 0.0, 1.0), 0)
    buffer = io.BytesIO()
    Image.fromarray(colors, "RGBA").save(buffer, format="PNG")
    west, north = transform.c, transform.f
    return Overlay(buffer.getvalue(), north, north + rows * transform.e, west + columns * transform.a, west)
