"""Our own detectors (``pipeline.training``): uint8 picture in, boxes and scores out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.detection.placement import Placement, letterbox
from pipeline.detection.session import Signature
from pipeline.messages import FloatArray


@dataclass(frozen=True, slots=True)
class SearchlightLayout:
    """image uint8 (1, H, W, 3) RGB -> boxes (1, N, 4) xyxy in input pixels, scores (1, N) in 0..1."""

    name: ClassVar[str] = "searchlight"
    nms_iou: ClassVar[float] = 0.5
    width: int
    height: int

    @classmethod
    def recognise(cls, signature: Signature) -> Self | None:
        """Ours say ``layout: searchlight`` in their metadata."""
        shape = signature.inputs.get("image")
        if signature.metadata.get("layout") != cls.name or shape is None or len(shape) != 4:
            return None
        _, height, width, _ = shape
        return cls(width, height) if isinstance(width, int) and isinstance(height, int) else None

    def prepare(self, image: NDArray[np.uint8]) -> tuple[dict[str, NDArray[Any]], Placement]:
        """See Layout."""
        placed, placement = letterbox(image, self.width, self.height, fill=114, centred=False)
        return {"image": placed[None]}, placement

    def decode(self, outputs: list[NDArray[np.float32]]) -> tuple[FloatArray, FloatArray]:
        """See Layout."""
        boxes, scores = outputs
        return boxes[0].astype(float), scores[0].astype(float)
