"""The ground of a mission: a surface model, a mesh, or a plane."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

from pydantic import model_validator

from pipeline.config.base import Strict, mismatch
from pipeline.config.units import Meters, PositiveMeters, Radians
from pipeline.geo.surface_model import HeightUnit

Datum = Literal["ellipsoid", "geoid"]


class MeshOrigin(Strict):
    """WGS84 position of a mesh's point (0, 0)."""

    latitude: Radians
    longitude: Radians

    @model_validator(mode="after")
    def _on_earth(self) -> MeshOrigin:
        for name, most_deg in (("latitude", 90.0), ("longitude", 180.0)):
            angle_deg = math.degrees(getattr(self, name))
            if abs(angle_deg) > most_deg:
                raise mismatch(f"{angle_deg:g} degrees", f"at most {most_deg:g} degrees", (name,))
        return self


class FlatGround(Strict):
    """A plane where no surface model is at hand. height: absent, that of the first flight's take-off.

    sd: how far the ground may be from it, one standard deviation; places are less sure by that.
    """

    height: Meters | None = None
    sd: PositiveMeters = 5.0


class Terrain(Strict):
    """A surface model (DSM): GeoTIFFs with a CRS, a mesh with an origin, or a plane; heights above the datum.

    file: one or several, or folders of them; where they overlap the first that knows a height counts.
    height_datum: absent, as the file says. unit, nodata: instead of what the file says. origin: where a mesh (x east,
    y north, z up, metres; PLY, OBJ, STL, OFF or GLB) lies. flat: instead of a file.
    """

    file: Path | tuple[Path, ...] | None = None
    height_datum: Datum | None = None
    unit: HeightUnit | None = None
    nodata: float | None = None
    origin: MeshOrigin | None = None
    flat: FlatGround | None = None

    @property
    def files(self) -> tuple[Path, ...]:
        """The files and folders named, in their order."""
        if self.file is None:
            return ()
        return self.file if isinstance(self.file, tuple) else (self.file,)

    @model_validator(mode="after")
    def _one_ground(self) -> Terrain:
        if bool(self.files) == (self.flat is not None):
            raise mismatch("a file and a plane" if self.files else "nothing", "file, or flat", ("file",))
        if self.origin is not None and len(self.files) != 1:
            raise mismatch(f"{len(self.files)} files", "one mesh, since there is an origin", ("file",))
        return self
