"""One detection that raised the map: the evidence that a salient location rests on."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pipeline.messages import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """score: 0..1. p: the probability of its positive update, 0.5..1. row, column: the voxel that it raised.

    intersection_enu: float64 (3,), where the ray of the significant point meets the terrain, metres.
    camera_enu: float64 (3,), metres. center_ray_enu: float64 (3,), unit direction of the box's centre.
    enu_from_camera: float64 (3, 3), the camera's attitude. pixel_rad: the angle that a pixel covers.
    class_name: what was detected, the map's layer. box: its number in the detector's result. horizontal_sd_m,
    height_sd_m, attitude_sd_rad: of the camera's pose, as in ``CameraPose``. focal_sd: of the camera's focal length,
    as a share of it. terrain_sd_m: of the ground's height beside the mission's, where something stands in for the
    surface model. trust: how far the score holds for what the detector was sent, 0..1.
    """

    time_ns: int
    stream: str
    detector: str
    score: float
    p: float
    row: int
    column: int
    intersection_enu: FloatArray
    camera_enu: FloatArray
    center_ray_enu: FloatArray
    enu_from_camera: FloatArray
    pixel_rad: float
    class_name: str = "person"
    box: int = 0
    horizontal_sd_m: float = math.nan
    height_sd_m: float = math.nan
    attitude_sd_rad: float = math.nan
    focal_sd: float = 0.0
    terrain_sd_m: float = 0.0
    trust: float = 1.0

    @property
    def order(self) -> tuple[int, str, str, int]:
        """The order of looks: that in which results are applied, and of the boxes in a result."""
        return self.time_ns, self.stream, self.detector, self.box
