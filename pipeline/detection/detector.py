"""A detector: a picture goes in, boxes of people come out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.detection.layouts import LAYOUTS, recognise
from pipeline.detection.layouts.base import Layout
from pipeline.detection.nms import non_maximum_suppression
from pipeline.detection.session import Session
from pipeline.errors import InputError
from pipeline.messages import FloatArray


class Detector:
    """An open model with its layout. The same picture gives the same boxes, bit for bit."""

    def __init__(self, session: Session, layout: Layout, score_threshold: float) -> None:
        self._session, self.layout, self.score_threshold = session, layout, score_threshold

    def detect(self, image: NDArray[np.uint8]) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
        """People in a picture (H, W, 3) RGB, highest score first.

        Boxes (N, 4) xyxy in pixels, inside the picture; scores (N,) of at least score_threshold; class ids
        (N,), all 0.
        """
        return self.chosen(image, *self.candidates(image))

    def candidates(self, image: NDArray[np.uint8]) -> tuple[FloatArray, FloatArray]:
        """All that the network says: boxes (N, 4) xyxy in pixels of the picture, and scores (N,)."""
        inputs, placement = self.layout.prepare(image)
        boxes, scores = self.layout.decode(self._session.run(inputs))
        return placement.image_from_input(boxes), scores

    def chosen(
        self, image: NDArray[np.uint8], boxes: FloatArray, scores: FloatArray
    ) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
        """Of candidates in a picture those that detect reports."""
        likely = scores >= self.score_threshold
        boxes, scores = boxes[likely], scores[likely]
        kept = non_maximum_suppression(boxes, scores, self.layout.nms_iou)
        height, width = image.shape[:2]
        inside = np.clip(boxes[kept], 0.0, [width, height, width, height])
        return inside, scores[kept], np.zeros(kept.size, np.int64)


def load_detector(path: Path, *, score_threshold: float, threads: int = 1, provider: str = "cpu") -> Detector:
    """Open an ONNX file of any known layout.

    Raises InputError if the file is missing, not ONNX or of an unknown layout, or the provider not installed.
    """
    session = Session(path, threads, provider)
    layout = recognise(session.signature)
    if layout is None:
        known = ", ".join(layout.name for layout in LAYOUTS)
        raise InputError(path, f"an unknown layout ({session.signature})", f"one of the layouts {known}")
    return Detector(session, layout, score_threshold)
