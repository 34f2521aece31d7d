"""How a mission says what its camera is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from pipeline.config.base import Strict, load, mismatch
from pipeline.config.units import Millimeters
from pipeline.geo.camera import Camera

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
_NUMBERS_OF_COEFFICIENTS = (4, 5, 8)


class Calibration(Strict):
    """Pinhole with OpenCV's distortion; pixels, counted from the corner of the first one.

    (OpenCV counts from the first pixel's centre: its cx and cy are half a pixel less.)
    """

    width: int = Field(ge=16, le=16384)
    """Of the picture, pixels. Example: `3840`."""
    height: int = Field(ge=16, le=16384)
    """Of the picture, pixels. Example: `2160`."""
    fx: Positive
    """Focal length along the width, pixels. Example: `2850.5`."""
    fy: Positive
    """Focal length along the height, pixels. Example: `2850.5`."""
    cx: float
    """Of the optical axis, from the left edge, pixels. Example: `1920`."""
    cy: float
    """Of the optical axis, from the upper edge, pixels. Example: `1080`."""
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2; k3; k4, k5, k6 of the rational model: 4, 5 or 8 numbers. Example: `[0.01, -0.02, 0, 0]`."""

    @model_validator(mode="after")
    def _distortion_is_one_of_opencvs(self) -> Calibration:
        count = len(self.distortion)
        if count not in _NUMBERS_OF_COEFFICIENTS:
            raise mismatch(
                f"{count} coefficients",
                "4 (k1, k2, p1, p2), 5 (and k3) or 8 (and k4, k5, k6)",
                ("distortion",),
            )
        return self

    def camera(self) -> Camera:
        """As the camera model that everything projects with."""
        coefficients = np.zeros(max(len(self.distortion), 5))
        coefficients[: len(self.distortion)] = self.distortion
        return Camera(self.width, self.height, self.fx, self.fy, self.cx, self.cy, coefficients)


class FieldOfView(Strict):
    """The whole angle that a picture shows, along its width, its height or its diagonal."""

    degrees: float = Field(gt=0.5, lt=170.0)
    """The whole angle. Example: `73.7`."""
    of: Literal["horizontal", "vertical", "diagonal"]
    """Along what."""

    @model_validator(mode="before")
    @classmethod
    def _says_which(cls, data: Any) -> Any:
        # makers print the diagonal one, calculators the horizontal one: they differ by a fifth
        if isinstance(data, dict) and "of" not in data:
            raise mismatch("a field of view without `of`", "of: horizontal, vertical or diagonal", ("of",))
        return data


class EquivalentFocalLength(Strict):
    """Of a 35 mm camera with the same field of view.

    Makers follow CIPA DCG-001, which takes the diagonal; where one says that it takes the width, say so.
    """

    millimeters: float = Field(ge=1.0, le=10_000.0)
    """As printed. Example: `24`."""
    of: Literal["diagonal", "horizontal"] = "diagonal"
    """Along the diagonal (43.27 mm) or the width (36 mm)."""


class CameraSource(Strict):
    """One of `file`, `field_of_view`, `equivalent_focal_length`, `intrinsics`; none of them: the metadata say."""

    file: Path | None = None
    """A calibration: Searchlight's, OpenCV's (YAML, XML, JSON) or ROS's camera_info; `camera: FILE` means the
    same. Example: `camera.yaml`.
    """
    field_of_view: FieldOfView | None = None
    """As data sheets give it."""
    equivalent_focal_length: EquivalentFocalLength | None = None
    """As data sheets and pictures give it."""
    intrinsics: Calibration | None = None
    """A calibration written here."""
    focal_length: Millimeters | None = None
    """Equivalent, as the telemetry states it, that the camera was calibrated at. Absent: the widest of the
    flight. Example: `{millimeters: 24}`.
    """

    @model_validator(mode="before")
    @classmethod
    def _path_is_a_file(cls, data: Any) -> Any:
        return {"file": data} if isinstance(data, str | Path) else data

    @model_validator(mode="after")
    def _says_one_thing(self) -> CameraSource:
        said = [name for name in _WAYS if getattr(self, name) is not None]
        if len(said) > 1:
            raise mismatch(" and ".join(said), f"one of {', '.join(_WAYS)}", (said[1],))
        return self


_WAYS = ("file", "field_of_view", "equivalent_focal_length", "intrinsics")


def load_camera(path: Path) -> Camera:
    """Read one of Searchlight's own calibration files."""
    return load(path, Calibration).camera()
