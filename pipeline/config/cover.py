"""Ground on which people are hidden from the air."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import model_validator

from pipeline.config.base import Strict, mismatch
from pipeline.config.units import Fraction

_RASTERS = (".tif", ".tiff", ".vrt")


class Cover(Strict):
    """Canopy or undergrowth: of people who lie there a share is hidden from every camera in the air."""

    file: Path
    """Polygons (GeoJSON, KML, KMZ), or a GeoTIFF whose values are the share hidden. Example: `forest.geojson`."""
    hidden: Fraction | None = None
    """Of people within the polygons, the share that no camera above can see, 0 to 1. Example: `0.6`."""
    unit: Literal["share", "percent"] = "share"
    """Of a GeoTIFF's values: 0 to 1, or 0 to 100."""

    @property
    def is_raster(self) -> bool:
        """Whether the file is a GeoTIFF."""
        return self.file.suffix.lower() in _RASTERS

    @model_validator(mode="after")
    def _share_is_said_once(self) -> Cover:
        if self.is_raster and self.hidden is not None:
            raise mismatch(f"{self.hidden:g} for a GeoTIFF", "nothing: its values are the share", ("hidden",))
        if not self.is_raster and self.hidden is None:
            raise mismatch("nothing", "the share of people hidden within the polygons, 0 to 1", ("hidden",))
        return self
