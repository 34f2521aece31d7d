"""How large a person is expected in a picture, from where it was taken: what accuracy depends on most."""

from __future__ import annotations

import math

#: a standing person as a cylinder
PERSON_HEIGHT_M = 1.7
PERSON_WIDTH_M = 0.5


def expected_person_px(height_m: float, pitch_rad: float, focal_px: float) -> float:
    """Square root of the area of the box around a standing person in the middle of the picture, pixels.

    height_m: of the camera above the ground, positive. pitch_rad: of the camera, negative is down; the
    horizon and above give 0, since the middle of the picture then shows no ground. focal_px: focal length.
    Seen at a depression p from the distance d = height / sin p, a cylinder of height H and width W is
    f (H cos p + W sin p) / d high and f W / d wide.
    """
    down = -pitch_rad
    if not 0.0 < down < math.pi or height_m <= 0.0:
        return 0.0
    scale = focal_px * math.sin(down) / height_m
    high = PERSON_HEIGHT_M * abs(math.cos(down)) + PERSON_WIDTH_M * math.sin(down)
    return scale * math.sqrt(high * PERSON_WIDTH_M)
