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
    """North is positive, -90 to 90 degrees. Example: `{degrees: 58.4}`."""
    longitude: Radians
    """East is positive, -180 to 180 degrees. Example: `{degrees: 15.57}`."""

    @model_validator(mode="after")
    def _on_earth(self) -> MeshOrigin:
        for name, most_deg in (("latitude", 90.0), ("longitude", 180.0)):
            angle_deg = math.degrees(getattr(self, name))
            if abs(angle_deg) > most_deg:
                raise mismatch(f"{angle_deg:g} degrees", f"at most {most_deg:g} degrees", (name,))
        return self


class FlatGround(Strict):
    """A plane, where no surface model is at hand."""

    height: Meters | None = None
    """Of the plane, above the terrain's datum. Absent: that of the first flight's take-off. Example: `{meters:
    93}`.
    """
    sd: PositiveMeters = 5.0
    """How far the ground may be from the plane, one standard deviation; places are less sure by that."""


class FallbackGround(Strict):
    """What stands for the ground where the surface models know no height: a coarser model, or a plane."""

    file: Path | tuple[Path, ...] | None = None
    """A coarser surface model, or several. Absent: a plane. Example: `glo30.tif`."""
    height: Meters | None = None
    """Of the plane, above the terrain's datum. Absent: that of the first flight's take-off. Example: `{meters:
    93}`.
    """
    height_datum: Datum | None = None
    """What the coarser model's heights are above. Absent: as its file says, else as the terrain's."""
    sd: PositiveMeters = 5.0
    """How far the ground may be from it, one standard deviation; places there are less sure by that."""

    @property
    def files(self) -> tuple[Path, ...]:
        """The files and folders named, in their order."""
        return _as_tuple(self.file)

    @model_validator(mode="after")
    def _one_of_them(self) -> FallbackGround:
        if self.file is not None and self.height is not None:
            raise mismatch("a file and a height", "file, or the height of a plane", ("height",))
        return self


class Terrain(Strict):
    """The ground: surface models (GeoTIFFs with a CRS), a mesh, or a plane."""

    file: Path | tuple[Path, ...] | None = None
    """One file or a list, or folders of them; where they overlap the first that knows a height counts. Example:
    `[dem/, more.tif]`.
    """
    height_datum: Datum | None = None
    """What its heights are above. Absent: as the file says."""
    unit: HeightUnit | None = None
    """Of its heights, instead of what the file says. Absent: as the file says, else metres."""
    nodata: float | None = None
    """The value that means unknown, instead of what the file says. Example: `-9999`."""
    origin: MeshOrigin | None = None
    """Where point (0, 0) of a mesh lies: x east, y north, z up, metres; PLY, OBJ, STL, OFF or GLB."""
    flat: FlatGround | None = None
    """A plane, instead of a file."""
    fallback: FallbackGround | None = None
    """What stands in where the files know no height. Absent: nothing is looked for there. Example: `{file: glo30.tif,
    sd: {meters: 4}}`.
    """

    @property
    def files(self) -> tuple[Path, ...]:
        """The files and folders named, in their order."""
        return _as_tuple(self.file)

    @model_validator(mode="after")
    def _one_ground(self) -> Terrain:
        if bool(self.files) == (self.flat is not None):
            raise mismatch("a file and a plane" if self.files else "nothing", "file, or flat", ("file",))
        if self.origin is not None and len(self.files) != 1:
            raise mismatch(f"{len(self.files)} files", "one mesh, since there is an origin", ("file",))
        if self.fallback is not None and (self.flat is not None or self.origin is not None):
            found = "a plane" if self.flat is not None else "a mesh"
            raise mismatch(
                f"{found} with a fallback", "surface models (terrain.file) that it completes", ("fallback",)
            )
        return self


def _as_tuple(file: Path | tuple[Path, ...] | None) -> tuple[Path, ...]:
    if file is None:
        return ()
    return file if isinstance(file, tuple) else (file,)
