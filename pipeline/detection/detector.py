"""A detector: a picture goes in, boxes of people come out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.config.pool import Calibration, PoolDetector
from pipeline.detection.layouts import LAYOUTS, recognise
from pipeline.detection.layouts.base import Layout
from pipeline.detection.nms import non_maximum_suppression
from pipeline.detection.session import Session
from pipeline.errors import InputError
from pipeline.messages import FloatArray
from pipeline.sensor.calibration import calibrated


class NotFiniteError(Exception):
    """A network that says NaN or infinite of a picture."""


class Detector:
    """An open model with its layout. The same picture gives the same boxes, bit for bit."""

    def __init__(
        self,
        session: Session,
        layout: Layout,
        score_threshold: float,
        calibration: Calibration | None = None,
    ) -> None:
        """score_threshold: of the network's own scores. calibration: what the reported ones are made with."""
        self._session, self.layout, self.score_threshold = session, layout, score_threshold
        self._calibration = calibration

    def detect(self, image: NDArray[np.uint8]) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
        """People in a picture (H, W, 3) RGB, highest score first.

        Boxes (N, 4) xyxy in pixels, inside the picture; scores (N,), calibrated, of candidates of at least
        score_threshold; class ids (N,), all 0. Raises NotFiniteError if the network says NaN or infinite: it
        has not seen the picture, and must not count as if it had found nothing there.
        """
        boxes, scores = self.candidates(image)
        if not self.finite(boxes, scores).all():
            raise NotFiniteError
        return self.chosen(image, boxes, scores)

    def candidates(self, image: NDArray[np.uint8]) -> tuple[FloatArray, FloatArray]:
        """All that the network says: boxes (N, 4) xyxy in pixels of the picture, and scores (N,)."""
        inputs, placement = self.layout.prepare(image)
        boxes, scores = self.layout.decode(self._session.run(inputs))
        return placement.image_from_input(boxes), scores

    def finite(self, boxes: FloatArray, scores: FloatArray) -> NDArray[np.bool_]:
        """Which candidates (N,) are finite; a box that would not be reported may be what it likes."""
        likely = np.isfinite(boxes).all(axis=1) | (scores < self.score_threshold)
        return np.isfinite(scores) & likely

    def chosen(
        self, image: NDArray[np.uint8], boxes: FloatArray, scores: FloatArray
    ) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
        """Of candidates in a picture those that detect reports."""
        likely = scores >= self.score_threshold
        boxes, scores = boxes[likely], scores[likely]
        kept = non_maximum_suppression(boxes, scores, self.layout.nms_iou)
        height, width = image.shape[:2]
        inside = np.clip(boxes[kept], 0.0, [width, height, width, height])
        worth = scores[kept] if self._calibration is None else calibrated(scores[kept], self._calibration)
        return inside, worth, np.zeros(kept.size, np.int64)


def load_detector(
    path: Path,
    *,
    score_threshold: float,
    threads: int = 1,
    provider: str = "cpu",
    calibration: Calibration | None = None,
) -> Detector:
    """Open an ONNX file of any known layout.

    Raises InputError if the file is missing, not ONNX or of an unknown layout, or the provider not installed.
    """
    session = Session(path, threads, provider)
    layout = recognise(session.signature)
    if layout is None:
        known = ", ".join(layout.name for layout in LAYOUTS)
        raise InputError(path, f"an unknown layout ({session.signature})", f"one of the layouts {known}")
    return Detector(session, layout, score_threshold, calibration)


def open_pool_detector(detector: PoolDetector) -> Detector:
    """A detector of the pool, as the pool says that it is used. Raises InputError as load_detector does."""
    model = detector.require_model(f"{detector.id}.model")
    return load_detector(model, score_threshold=detector.score_threshold, calibration=detector.calibration)
