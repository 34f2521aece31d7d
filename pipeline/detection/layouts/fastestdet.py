"""FastestDet (https://github.com/dog-qiuqiu/FastestDet): one grid, objectness beside classes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.detection.layouts.base import boxes_around, grid_corners, planar
from pipeline.detection.placement import Placement, stretch
from pipeline.detection.session import Signature
from pipeline.messages import FloatArray

_PERSON = 5  # objectness, x, y, w, h, then the classes; COCO's first is the person
_STRIDE = 16


@dataclass(frozen=True, slots=True)
class FastestDetLayout:
    """(1, 85, H / 16, W / 16): objectness, tanh offset, sigmoid size in shares of the picture, classes."""

    name: ClassVar[str] = "fastestdet"
    nms_iou: ClassVar[float] = 0.6
    input: str
    width: int
    height: int

    @classmethod
    def recognise(cls, signature: Signature) -> Self | None:
        """By its one map of 85 planes at stride 16."""
        if len(signature.inputs) != 1 or len(signature.outputs) != 1:
            return None
        ((name, shape),) = signature.inputs.items()
        if len(shape) != 4 or not isinstance(shape[2], int) or not isinstance(shape[3], int):
            return None
        height, width = shape[2], shape[3]
        (output,) = signature.outputs.values()
        return cls(name, width, height) if output == (1, 85, height // _STRIDE, width // _STRIDE) else None

    def prepare(self, image: NDArray[np.uint8]) -> tuple[dict[str, NDArray[Any]], Placement]:
        """See Layout."""
        placed, placement = stretch(image, self.width, self.height, "linear")
        return {self.input: planar(placed[..., ::-1]) / np.float32(255.0)}, placement

    def decode(self, outputs: list[NDArray[np.float32]]) -> tuple[FloatArray, FloatArray]:
        """See Layout."""
        cells = outputs[0][0].reshape(85, -1).T.astype(float)
        corners, stride = grid_corners(self.width, self.height, (_STRIDE,))
        centres = (corners + np.tanh(cells[:, 1:3])) * stride
        sizes = np.array([self.width, self.height]) / (1.0 + np.exp(-cells[:, 3:5]))
        return boxes_around(centres, sizes), cells[:, 0] ** 0.6 * cells[:, _PERSON] ** 0.4
