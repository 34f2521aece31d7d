"""The camera that DJI's drones write into the XMP of their stills.

DewarpData is the factory's calibration of the very camera: fx, fy, cx, cy (pixels, cx and cy from the picture's
middle), k1, k2, p1, p2, k3, and DewarpDataK6 with k4, k5, k6 too; DewarpFlag is 1 where the picture was straightened
with them already. CalibratedFocalLength and CalibratedOpticalCenterX, Y are the lens's design (DJI, "Mavic 3M User
Manual", 2023, page 90; "Matrice 4 Series User Manual", 2025, page 91).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.geo.camera import Camera
from pipeline.messages import FloatArray

#: what the tags are called
TAGS = (
    *("DewarpData", "DewarpDataK6", "DewarpFlag"),
    *("CalibratedFocalLength", "CalibratedOpticalCenterX", "CalibratedOpticalCenterY"),
)
#: of a calibrated focal length, and of a design (judgements: 3713.8 pixels calibrated, 3725.2 by design, of one camera)
_CALIBRATED_SD, _DESIGN_SD = 0.003, 0.01
#: stills of one camera have one calibration; as shares of the focal length
_SAME = 0.01
#: a calibration for pictures of another size than these: by its optical centre, which is near the middle
_OFF_MIDDLE = 0.05


def dji_camera(tags: Mapping[str, str], width: int, height: int) -> Camera | None:
    """The camera of one still, None if its tags do not tell, or are of pictures of another size."""
    if width <= 0 or height <= 0 or not _is_of_size(tags, width, height):
        return None
    straightened = tags.get("DewarpFlag", "").strip() == "1"
    for name, count in (("DewarpDataK6", 12), ("DewarpData", 9)):
        values = _numbers(tags.get(name, ""))
        if len(values) == count and values[0] > 0.0 and values[1] > 0.0:
            return _dewarped(values, width, height, straightened)
    focal = _numbers(tags.get("CalibratedFocalLength", ""))
    if len(focal) != 1 or not 0.1 * width < focal[0] < 100.0 * width:
        return None
    return Camera(width, height, focal[0], focal[0], width / 2.0, height / 2.0, np.zeros(5), _DESIGN_SD)


def common_camera(cameras: Sequence[Camera | None]) -> Camera | None:
    """The one camera of stills; None if one has none, or they differ (another lens, or a zoom)."""
    known = [camera for camera in cameras if camera is not None]
    if not known or len(known) < len(cameras):
        return None
    first = known[0]
    same = all(
        (c.width, c.height) == (first.width, first.height) and abs(c.fx / first.fx - 1.0) < _SAME
        for c in known
    )
    return first if same else None


def _dewarped(values: list[float], width: int, height: int, straightened: bool) -> Camera | None:
    fx, fy, cx, cy, *coefficients = values
    if not 0.1 * width < fx < 100.0 * width or max(abs(cx) / width, abs(cy) / height) > _OFF_MIDDLE:
        return None
    distortion: FloatArray = np.zeros(5) if straightened else np.array(coefficients)
    return Camera(width, height, fx, fy, width / 2.0 + cx, height / 2.0 + cy, distortion, _CALIBRATED_SD)


def _is_of_size(tags: Mapping[str, str], width: int, height: int) -> bool:
    """By the design's optical centre, if the tags have it."""
    for name, extent in (("CalibratedOpticalCenterX", width), ("CalibratedOpticalCenterY", height)):
        center = _numbers(tags.get(name, ""))
        if len(center) == 1 and abs(center[0] / extent - 0.5) > _OFF_MIDDLE:
            return False
    return True


def _numbers(text: str) -> list[float]:
    """After a date and a semicolon, if there is one; empty if one is no finite number."""
    try:
        values = [float(part) for part in text.rpartition(";")[2].split(",")]
    except ValueError:
        return []
    return values if all(math.isfinite(value) for value in values) else []
