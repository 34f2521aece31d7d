"""What the fuser needs to know of a camera at one focal length."""

from __future__ import annotations

import math

from pipeline.config.fusion import Fusion
from pipeline.geo.camera import Camera
from pipeline.sensor.model import SensorModel

#: focal lengths of all streams that are kept: a zoom passes through many, and few come back
_KEPT = 64


class Optics:
    """camera: as it was zoomed. models: by class name. reach_m: what it sees of any class. pixel_rad: the

    angle that a pixel covers.
    """

    def __init__(self, camera: Camera, params: Fusion) -> None:
        self.camera = camera
        self.models = {c.name: SensorModel(camera, params, c) for c in params.classes}
        self.reach_m = max(model.max_distance_m for model in self.models.values())
        self.pixel_rad = 1.0 / math.sqrt(camera.fx * camera.fy)


class OpticsByFocalLength:
    """The optics of one stream's camera at each focal length that comes up."""

    def __init__(self, camera: Camera, params: Fusion) -> None:
        self._camera, self._params = camera, params
        self._usual = Optics(camera, params)
        # a plain record, since the map goes from one process to another with all that belongs to it
        self._zoomed: dict[float, Optics] = {}

    def at(self, focal_scale: float) -> Optics:
        """focal_scale: focal length over that of the camera."""
        if focal_scale == 1.0:
            return self._usual
        if focal_scale not in self._zoomed:
            while len(self._zoomed) >= _KEPT:
                del self._zoomed[next(iter(self._zoomed))]
            self._zoomed[focal_scale] = Optics(self._camera.zoomed(focal_scale), self._params)
        return self._zoomed[focal_scale]
