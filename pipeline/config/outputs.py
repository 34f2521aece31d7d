"""What a run writes beside its own files."""

from __future__ import annotations

from typing import Literal
from zoneinfo import ZoneInfo

from pydantic import field_validator

from pipeline.config.base import Strict, mismatch

ExportFormat = Literal["geojson", "kml", "kmz", "gpx", "csv", "cog", "gpkg", "caltopo", "cot", "pdf"]


class Outputs(Strict):
    """What a run writes for people and other tools."""

    formats: tuple[ExportFormat, ...] = ()
    """Into the folder `exports` of the run directory, see [outputs](outputs.md). Absent: none; `searchlight export`
    writes them later. Example: `[kmz, gpx, csv]`.
    """
    time_zone: str | None = None
    """Of the times in the report, a name of the IANA data base. Absent: that of the machine that writes it. Example:
    `Europe/Stockholm`.
    """

    @field_validator("time_zone")
    @classmethod
    def _zone_is_known(cls, name: str | None) -> str | None:
        try:
            return name if name is None else ZoneInfo(name).key
        except (KeyError, ValueError, OSError):
            raise mismatch(repr(name), "a name of the IANA data base, such as Europe/Stockholm") from None
