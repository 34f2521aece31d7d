"""Boxes drawn into pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import FloatArray

_COLOURS = np.array([[255, 40, 40], [40, 160, 255], [255, 200, 0], [60, 220, 60], [230, 80, 230]], np.uint8)


def with_boxes(image: NDArray[np.uint8], boxes: FloatArray, classes: NDArray[np.int64]) -> NDArray[np.uint8]:
    """A copy of the picture (H, W, 3) with the edges of boxes (N, 4) xyxy, one colour for each class."""
    drawn = image.copy()
    height, width = image.shape[:2]
    thick = max(1, round(max(height, width) / 800))
    for box, kind in zip(np.rint(boxes).astype(int), classes, strict=True):
        x0, y0, x1, y1 = np.clip(box, 0, [width - 1, height - 1, width - 1, height - 1])
        colour = _COLOURS[int(kind) % len(_COLOURS)]
        drawn[y0 : y0 + thick, x0 : x1 + 1] = colour
        drawn[max(y0, y1 - thick + 1) : y1 + 1, x0 : x1 + 1] = colour
        drawn[y0 : y1 + 1, x0 : x0 + thick] = colour
        drawn[y0 : y1 + 1, max(x0, x1 - thick + 1) : x1 + 1] = colour
    return drawn
