"""NanoDet (https://github.com/RangiLyu/nanodet), the export with six outputs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.detection.layouts.base import grid_corners, planar
from pipeline.detection.placement import Placement, letterbox
from pipeline.detection.session import Signature
from pipeline.messages import FloatArray

_STRIDES = (8, 16, 32)
_BINS = 8
_MEAN_BGR = np.array([103.53, 116.28, 123.675], np.float32).reshape(1, 3, 1, 1)
_STD_BGR = np.array([57.375, 57.12, 58.395], np.float32).reshape(1, 3, 1, 1)


@dataclass(frozen=True, slots=True)
class NanoDetLayout:
    """At strides 8, 16, 32: scores (1, cells, 80); then distributions of edge distances (1, cells, 4 x 8)."""

    name: ClassVar[str] = "nanodet"
    nms_iou: ClassVar[float] = 0.6
    input: str
    width: int
    height: int

    @classmethod
    def recognise(cls, signature: Signature) -> Self | None:
        """By its six outputs and the number of cells at strides 8, 16 and 32."""
        if len(signature.inputs) != 1:
            return None
        ((name, shape),) = signature.inputs.items()
        if len(shape) != 4 or not isinstance(shape[2], int) or not isinstance(shape[3], int):
            return None
        height, width = shape[2], shape[3]
        cells = [(height // stride) * (width // stride) for stride in _STRIDES]
        expected = [(1, n, 80) for n in cells] + [(1, n, 4 * _BINS) for n in cells]
        return cls(name, width, height) if list(signature.outputs.values()) == expected else None

    def prepare(self, image: NDArray[np.uint8]) -> tuple[dict[str, NDArray[Any]], Placement]:
        """See Layout."""
        placed, placement = letterbox(image, self.width, self.height, fill=0, centred=True)
        return {self.input: (planar(placed[..., ::-1]) - _MEAN_BGR) / _STD_BGR}, placement

    def decode(self, outputs: list[NDArray[np.float32]]) -> tuple[FloatArray, FloatArray]:
        """See Layout."""
        scores = np.concatenate([scores[0, :, 0] for scores in outputs[:3]]).astype(float)
        bins = np.concatenate([bins[0] for bins in outputs[3:]]).astype(float).reshape(-1, 4, _BINS)
        corners, stride = grid_corners(self.width, self.height, _STRIDES)
        weights = np.exp(bins - bins.max(axis=2, keepdims=True))
        distances = stride * (weights @ np.arange(_BINS)) / weights.sum(axis=2)
        centres = (corners + 0.5) * stride
        return np.concatenate([centres - distances[:, :2], centres + distances[:, 2:]], axis=1), scores
