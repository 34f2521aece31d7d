"""What one look at a place says about it: the paper's sensor model.

Readings taken where the paper is open:

- The area component compares *areas*: the window's lower and upper ends are ``bbox_w * bbox_h`` of the least
  and of the greatest object at the distance of the hit, and the box's area is its place in the window.
- ``max_distance`` is where the least object's box has shrunk to SMALLEST_BOX_PX on a side (its geometric
  mean): the equation of the box size, solved for the distance, needs a size in pixels that the paper does not
  name.
- Boxes are in pixels of the calibrated picture, so the ratio input / calibration of the box size equation is
  1 in a run.
"""

from __future__ import annotations

import math

import numpy as np

from pipeline.config.fusion import PERSON_HEIGHT_M, Fusion, ObjectClass
from pipeline.geo.camera import Camera
from pipeline.messages import FloatArray

#: Side of the smallest box that a detector can find, pixels: one cell of a network's finest usual feature map
#: (stride 4).
SMALLEST_BOX_PX = 4.0


def bbox_size_px(
    object_m: float, distance_m: float, focal_px: float, input_px: float, calibration_px: float
) -> float:
    """Side of the box of an object of this size at this distance (eq:bbox_size)."""
    return input_px * focal_px * object_m / (calibration_px * distance_m)


def tukey_window(position: float, alpha: float) -> float:
    """The cosine-tapered window over 0..1: 0 outside, rectangular at alpha 0, Hann's at alpha 1."""
    if not 0.0 <= position <= 1.0:
        return 0.0
    edge = min(position, 1.0 - position)
    if edge >= alpha / 2.0:
        return 1.0
    return 0.5 * (1.0 - math.cos(2.0 * math.pi * edge / alpha))


def distance_factor(distance_m: FloatArray, max_distance_m: float) -> FloatArray:
    """How well a place at this distance is observed, 0..1 (eq:dist_factor)."""
    return np.maximum(1.0 - distance_m / max_distance_m, 0.0)


def p_positive(p_area: float, p_detector: float, score: float, positive_max: float) -> float:
    """P(n|z_t) of a detection, 0.5..1 (eq:p_positive)."""
    return 0.5 + p_area * p_detector * score * positive_max


def p_negative(p_distance: FloatArray, p_detector: float, negative_max: float) -> FloatArray:
    """P(n|z_t) of a place where nothing was detected, 0..0.5 (eq:p_negative)."""
    return 0.5 - p_distance * p_detector * negative_max


class SensorModel:
    """The model of one camera that looks for objects of one class."""

    def __init__(self, camera: Camera, params: Fusion, object_class: ObjectClass | None = None) -> None:
        """object_class: persons if absent."""
        self.object_class = object_class or params.classes[0]
        self._camera, self._params, self._size = camera, params, self.object_class.object_size
        size = self._size
        least_px_m = math.sqrt(self._box_area_px2(size.width_min, size.height_min, 1.0))
        greatest_px_m = math.sqrt(self._box_area_px2(size.width_max, size.height_max, 1.0))
        #: beyond it the least object is not seen, metres
        self.max_distance_m = least_px_m / SMALLEST_BOX_PX
        #: beyond it no object of the class is seen, metres
        self.reach_m = greatest_px_m / SMALLEST_BOX_PX
        self.negative_max = params.negative_max
        #: pixels per person of PERSON_HEIGHT_M times the distance, metres
        self.resolution_px_m = bbox_size_px(PERSON_HEIGHT_M, 1.0, camera.fy, camera.height, camera.height)
        #: of a typical object
        self.typical_height_m = self.object_class.typical_height or (size.height_min + size.height_max) / 2.0
        #: root of the area of a typical object's box, pixels, times the distance, metres
        self.typical_px_m = math.sqrt(self._box_area_px2(self._typical_width_m(), self.typical_height_m, 1.0))
        #: the area component of a typical object, the same at every distance
        self.typical_area_component = self._typical_area_component()

    def positive(self, box_px: FloatArray, score: float, distance_m: float, p_detector: float) -> float:
        """Probability of a detection's voxel: box (4,) x0, y0, x1, y1; score and p_detector in 0..1."""
        area = self.area_component(box_px, distance_m)
        return p_positive(area, p_detector, score, self._params.positive_max)

    def negative(self, distance_m: FloatArray, p_detector: float) -> FloatArray:
        """Probabilities (N,) of seen voxels at these distances (N,) that hold no detection."""
        factor = distance_factor(distance_m, self.max_distance_m)
        return p_negative(factor, p_detector, self._params.negative_max)

    def frame_pod(self, distance_m: float, p_detector: float) -> float:
        """POD of one frame: that a typical object at this distance would have been detected.

        The paper's components, each the share of objects that one circumstance leaves: distance, size (Tukey
        window) and detector. p_det^rel is relative to the best of the pool, so POD is too.
        """
        factor = float(distance_factor(np.array(distance_m), self.max_distance_m))
        return factor * self.typical_area_component * p_detector

    def area_component(self, box_px: FloatArray, distance_m: float) -> float:
        """p_bbox^area, 0..1: how well the box's area fits an object of the class at this distance."""
        area = float((box_px[2] - box_px[0]) * (box_px[3] - box_px[1]))
        return self._area_component(area, distance_m)

    def _area_component(self, area_px2: float, distance_m: float) -> float:
        least = self._box_area_px2(self._size.width_min, self._size.height_min, distance_m)
        greatest = self._box_area_px2(self._size.width_max, self._size.height_max, distance_m)
        return tukey_window((area_px2 - least) / (greatest - least), self._params.tukey_alpha)

    def _typical_width_m(self) -> float:
        return self.object_class.typical_width or (self._size.width_min + self._size.width_max) / 2.0

    def _typical_area_component(self) -> float:
        area_px2 = self._box_area_px2(self._typical_width_m(), self.typical_height_m, 1.0)
        return self._area_component(area_px2, 1.0)

    def _box_area_px2(self, width_m: float, height_m: float, distance_m: float) -> float:
        c = self._camera
        return bbox_size_px(width_m, distance_m, c.fx, c.width, c.width) * bbox_size_px(
            height_m, distance_m, c.fy, c.height, c.height
        )
