"""What makes a result, or one of its boxes, unusable: each fault is a reason in words."""

from __future__ import annotations

import math

from pipeline.geo.camera import Camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, Detections

#: A rotation's rows may differ from an orthonormal basis by this much.
_ROTATION_TOLERANCE = 1e-6
#: A focal length this many times shorter or longer than the camera's is no zoom but a slip.
_MOST_ZOOM = 1000.0
#: A box whose edge is this near to the picture's border counts as cut by it.
_BORDER_PX = 2.0

Box = tuple[float, float, float, float]


def shape_fault(detections: Detections) -> str | None:
    """Why the arrays of a result do not belong together, if so."""
    n = len(detections.boxes_px)
    if detections.boxes_px.shape != (n, 4) or detections.scores.shape != (n,):
        return "boxes and scores of different number"
    if detections.class_ids.shape != (n,):
        return "boxes and classes of different number"
    return None


def pose_fault(pose: CameraPose, terrain: Terrain) -> str | None:
    """Why nothing can be seen from a pose over a terrain, if so."""
    position, rotation = pose.position_enu.tolist(), pose.enu_from_camera
    if not all(map(math.isfinite, (*position, *rotation.ravel().tolist()))):
        return "pose with NaN"
    if (fault := _stated_fault(pose)) is not None:
        return fault
    if not _is_rotation(rotation.tolist()):
        return "attitude that is no rotation"
    if terrain.cell(position[0], position[1])[0] < 0:
        return "pose outside the terrain"
    if position[2] <= terrain.height(position[0], position[1]):
        return "pose under the ground"
    return None


def _stated_fault(pose: CameraPose) -> str | None:
    """What a pose says of itself and of its lens; NaN: it says nothing."""
    sds = (pose.horizontal_sd_m, pose.height_sd_m, pose.attitude_sd_rad)
    if any(sd < 0.0 or sd == math.inf for sd in sds):
        return "impossible standard deviation"
    return None if 1.0 / _MOST_ZOOM < pose.focal_scale < _MOST_ZOOM else "impossible focal length"


def _is_rotation(rows: list[list[float]]) -> bool:
    """Whether the third row is the cross product of the first two, and these are orthonormal."""
    (a, b, c), (d, e, f), third = rows
    lengths = (a * a + b * b + c * c - 1.0, d * d + e * e + f * f - 1.0, a * d + b * e + c * f)
    cross = (b * f - c * e, c * d - a * f, a * e - b * d)
    errors = (*lengths, *(x - y for x, y in zip(cross, third, strict=True)))
    return max(map(abs, errors)) <= _ROTATION_TOLERANCE


def box_fault(box: Box, score: float, camera: Camera) -> str | None:
    """Why one box, x0, y0, x1, y1 in pixels, can not be used, if so."""
    x0, y0, x1, y1 = box
    if not all(map(math.isfinite, box)):
        return "box with NaN"
    if x1 <= x0 or y1 <= y0:
        return "box without area"
    if x1 <= 0.0 or y1 <= 0.0 or x0 >= camera.width or y0 >= camera.height:
        return "box outside the picture"
    if not 0.0 <= score <= 1.0:
        return "score outside 0..1"
    return None


def is_cut(box: Box, camera: Camera) -> bool:
    """Whether a box is cut by the picture's border."""
    x0, y0, x1, y1 = box
    right, low = camera.width - _BORDER_PX, camera.height - _BORDER_PX
    return x0 < _BORDER_PX or y0 < _BORDER_PX or x1 > right or y1 > low
