"""The camera's calibration file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from pipeline.config.base import Strict, load
from pipeline.geo.camera import Camera

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]


class Calibration(Strict):
    """Pinhole with Brown-Conrady distortion, as OpenCV's calibrateCamera gives it; pixels.

    distortion: k1, k2, p1, p2, k3.
    """

    width: int = Field(ge=16, le=16384)
    height: int = Field(ge=16, le=16384)
    fx: Positive
    fy: Positive
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)


def load_camera(path: Path) -> Camera:
    """Read a calibration file."""
    c = load(path, Calibration)
    return Camera(c.width, c.height, c.fx, c.fy, c.cx, c.cy, np.array(c.distortion))
