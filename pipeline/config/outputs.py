"""What a run writes beside its own files."""

from __future__ import annotations

from typing import Literal

from pipeline.config.base import Strict

ExportFormat = Literal["geojson", "kml", "kmz", "gpx", "csv", "cog", "gpkg", "caltopo", "cot", "pdf"]


class Outputs(Strict):
    """What a run writes for other tools."""

    formats: tuple[ExportFormat, ...] = ()
    """Into the folder `exports` of the run directory, see [outputs](outputs.md). Absent: none; `searchlight export`
    writes them later. Example: `[kmz, gpx, csv]`.
    """
