"""How a picture is placed in a network's input, and the way back for boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.detection.resize import Filter, resize
from pipeline.messages import FloatArray


@dataclass(frozen=True, slots=True)
class Placement:
    """input = picture * scale + offset, both in pixels, along x and y."""

    scale_x: float
    scale_y: float
    left: int = 0
    top: int = 0

    def image_from_input(self, boxes: FloatArray) -> FloatArray:
        """Boxes (N, 4) xyxy in pixels of the picture, of boxes in pixels of the network's input."""
        return (boxes - self._offset) / self._scale

    def input_from_image(self, boxes: FloatArray) -> FloatArray:
        """The inverse of image_from_input."""
        return boxes * self._scale + self._offset

    @property
    def _scale(self) -> FloatArray:
        return np.array([self.scale_x, self.scale_y] * 2)

    @property
    def _offset(self) -> FloatArray:
        return np.array([self.left, self.top] * 2, float)


def stretch(
    image: NDArray[np.uint8], width: int, height: int, method: Filter = "area"
) -> tuple[NDArray[np.uint8], Placement]:
    """The picture resized to exactly height x width, whatever its aspect."""
    return resize(image, width, height, method), Placement(width / image.shape[1], height / image.shape[0])


def letterbox(
    image: NDArray[np.uint8],
    width: int,
    height: int,
    *,
    fill: int,
    centred: bool,
    method: Filter = "area",
) -> tuple[NDArray[np.uint8], Placement]:
    """The picture as large as it fits with its aspect kept, the rest grey of value fill.

    centred: in the middle, else at the top left.
    """
    fit = min(width / image.shape[1], height / image.shape[0])
    inner_width, inner_height = (max(1, round(size * fit)) for size in (image.shape[1], image.shape[0]))
    inner, placement = stretch(image, inner_width, inner_height, method)
    if (inner_width, inner_height) == (width, height):
        return inner, placement
    left, top = ((width - inner_width) // 2, (height - inner_height) // 2) if centred else (0, 0)
    canvas = np.full((height, width, 3), fill, np.uint8)
    canvas[top : top + inner_height, left : left + inner_width] = inner
    return canvas, Placement(placement.scale_x, placement.scale_y, left, top)
