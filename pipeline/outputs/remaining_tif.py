"""Where a person who was not found may still be, as a GeoTIFF."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rasterio
from rasterio.transform import from_origin

from pipeline.geo.terrain import Terrain
from pipeline.outputs.partial import Partial
from pipeline.second_look.prior import Remaining
from pipeline.storage.versions import stamp
from pipeline.storage.whole_or_nothing import replacing


def write_remaining(
    path: Path, remaining: Remaining, terrain: Terrain, partial: Partial | None = None
) -> None:
    """Two float32 bands, north up: ``remaining``, the probability that the person is in the cell and was missed, and
    ``poa``, that it was there before anybody looked. With the tag ELSEWHERE the first sums to 1. The CRS is that of the
    map frame. partial: of a run that ended too early; its sentence is the tag PARTIAL.
    """
    rows, columns = terrain.shape
    north_m = terrain.north_m + rows * terrain.cell_m
    bands = np.stack([remaining.left[::-1], remaining.poa[::-1]]).astype(np.float32)
    with (
        replacing(path) as temporary,
        rasterio.open(
            temporary,
            "w",
            driver="GTiff",
            dtype="float32",
            count=2,
            height=rows,
            width=columns,
            crs=terrain.frame.crs.to_wkt(),
            transform=from_origin(terrain.east_m, north_m, terrain.cell_m, terrain.cell_m),
            tiled=True,
            compress="deflate",
            predictor=3,
            bigtiff="if_safer",
        ) as target,
    ):
        target.write(bands)
        tags = {key.upper(): str(value) for key, value in stamp("remaining").items()}
        tags |= {
            "ELSEWHERE": f"{1.0 - remaining.left.sum():.6g}",
            "PROBABILITY_OF_SUCCESS": f"{remaining.pos:.6g}",
        }
        target.update_tags(**tags | ({} if partial is None else {"PARTIAL": partial.sentence}))
        target.descriptions = ("remaining", "poa")
