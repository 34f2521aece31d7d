"""DEIM and its relatives of the RT-DETR family: a set of boxes without duplicates, decoded in the graph."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.detection.layouts.base import planar
from pipeline.detection.placement import Placement, stretch
from pipeline.detection.session import Signature
from pipeline.messages import FloatArray

_PERSON = 0


@dataclass(frozen=True, slots=True)
class DeimLayout:
    """labels (N,), boxes (N, 4) xyxy in the size that orig_target_sizes asks for, scores (N,).

    Some exports have a batch axis of 1 before.
    """

    name: ClassVar[str] = "deim"
    nms_iou: ClassVar[float] = 1.0
    width: int
    height: int

    @classmethod
    def recognise(cls, signature: Signature) -> Self | None:
        """By the names of its inputs and outputs."""
        if set(signature.inputs) != {"images", "orig_target_sizes"}:
            return None
        if list(signature.outputs) != ["labels", "boxes", "scores"]:
            return None
        height, width = signature.inputs["images"][2:]
        return cls(width, height) if isinstance(width, int) and isinstance(height, int) else None

    def prepare(self, image: NDArray[np.uint8]) -> tuple[dict[str, NDArray[Any]], Placement]:
        """See Layout."""
        placed, placement = stretch(image, self.width, self.height, "triangle")
        inputs = {
            "images": planar(placed) / np.float32(255.0),
            "orig_target_sizes": np.array([[self.width, self.height]], np.int64),
        }
        return inputs, placement

    def decode(self, outputs: list[NDArray[np.float32]]) -> tuple[FloatArray, FloatArray]:
        """See Layout."""
        labels, boxes, scores = outputs
        person = labels.reshape(-1) == _PERSON
        return boxes.reshape(-1, 4)[person].astype(float), scores.reshape(-1)[person].astype(float)
