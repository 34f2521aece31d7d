"""YOLOX (https://github.com/Megvii-BaseDetection/YOLOX) without decoding in the graph."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.detection.layouts.base import boxes_around, grid_corners, planar
from pipeline.detection.placement import Placement, letterbox
from pipeline.detection.session import Signature
from pipeline.messages import FloatArray

_STRIDES = (8, 16, 32)


@dataclass(frozen=True, slots=True)
class YoloxLayout:
    """(1, cells, 5 + classes): offset, log size, objectness, classes. The person is the first class."""

    name: ClassVar[str] = "yolox"
    nms_iou: ClassVar[float] = 0.45
    columns: ClassVar[int] = 85
    input: str
    width: int
    height: int

    @classmethod
    def recognise(cls, signature: Signature) -> Self | None:
        """By the number of cells at strides 8, 16 and 32, and of columns."""
        if len(signature.inputs) != 1 or len(signature.outputs) != 1:
            return None
        ((name, shape),) = signature.inputs.items()
        if len(shape) != 4 or not isinstance(shape[2], int) or not isinstance(shape[3], int):
            return None
        height, width = shape[2], shape[3]
        cells = sum((height // stride) * (width // stride) for stride in _STRIDES)
        (output,) = signature.outputs.values()
        return cls(name, width, height) if output == (1, cells, cls.columns) else None

    def prepare(self, image: NDArray[np.uint8]) -> tuple[dict[str, NDArray[Any]], Placement]:
        """See Layout."""
        placed, placement = letterbox(
            image, self.width, self.height, fill=114, centred=False, method="linear"
        )
        return {self.input: planar(placed[..., ::-1])}, placement

    def decode(self, outputs: list[NDArray[np.float32]]) -> tuple[FloatArray, FloatArray]:
        """See Layout."""
        cells = outputs[0][0].astype(float)
        corners, stride = grid_corners(self.width, self.height, _STRIDES)
        boxes = boxes_around((cells[:, :2] + corners) * stride, np.exp(cells[:, 2:4]) * stride)
        return boxes, cells[:, 4] * cells[:, 5]


class LightPersonLayout(YoloxLayout):
    """The same with the person as its only class: 6 columns."""

    name: ClassVar[str] = "light_person"
    nms_iou: ClassVar[float] = 0.5
    columns: ClassVar[int] = 6
