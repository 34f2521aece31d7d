"""A detector: a picture goes in, boxes of what is searched for come out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.config.layout import Layout
from pipeline.config.pool import Calibration, PoolDetector
from pipeline.detection.class_names import PERSON, class_groups, known_names
from pipeline.detection.decoders import decode
from pipeline.detection.nms import non_maximum_suppression
from pipeline.detection.preparation import Preparation
from pipeline.detection.recognition import Recognised, recognise
from pipeline.detection.session import Session
from pipeline.detection.trial import one_picture, preparation_of
from pipeline.messages import FloatArray
from pipeline.sensor.calibration import calibrated

IntArray = NDArray[np.int64]
#: candidates below it are nothing to anybody, and are not decoded
LEAST_SCORE = 1e-4
PERSONS = {PERSON: 0}


class NotFiniteError(Exception):
    """A network that says NaN or infinite of a picture."""


class Runs(Protocol):
    """What a detector needs of a session."""

    def run(self, inputs: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Outputs by name."""


class Detector:
    """An open model with its layout. The same picture gives the same boxes, bit for bit."""

    def __init__(
        self,
        session: Runs,
        layout: Layout,
        preparation: Preparation,
        classes: Mapping[int, tuple[int, ...]],
        score_threshold: float,
        calibration: Calibration | None = None,
        recognised: Recognised | None = None,
    ) -> None:
        """classes: of each class that is reported, which of the network's are it. score_threshold: of the
        network's own scores. calibration: what the reported ones are made with.
        """
        self._session, self.layout, self.score_threshold = session, layout, score_threshold
        self._preparation, self._calibration = preparation, calibration
        self._ids = np.array(list(classes), np.int64)
        self._groups = tuple(classes.values())
        self.recognised = recognised

    def detect(self, image: NDArray[np.uint8]) -> tuple[FloatArray, FloatArray, IntArray]:
        """Objects in a picture (H, W, 3) RGB, of each class by falling score.

        Boxes (N, 4) xyxy in pixels, inside the picture; scores (N,), calibrated, of candidates of at least
        score_threshold; class ids (N,) of the map's layers, 0 for persons. Raises NotFiniteError if the
        network says NaN or infinite: it has not seen the picture, and must not count as if it had found
        nothing there.
        """
        boxes, scores, classes = self.candidates(image, min(self.score_threshold, 1.0))
        if not self.finite(boxes, scores).all():
            raise NotFiniteError
        return self.chosen(image, boxes, scores, classes)

    def candidates(
        self, image: NDArray[np.uint8], least: float = LEAST_SCORE
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        """All that the network says from a score on, or NaN: boxes (N, 4) xyxy in pixels of the picture,
        scores (N,), class ids (N,).
        """
        placed, placement = self._preparation.place(image)
        outputs = one_picture(self._session.run(self._preparation.inputs([placed])))
        size = (placed.shape[1], placed.shape[0])
        found = decode(outputs, size, self.layout, self._groups, least)
        return placement.image_from_input(found.boxes), found.scores, self._ids[found.group]

    def finite(self, boxes: FloatArray, scores: FloatArray) -> NDArray[np.bool_]:
        """Which candidates (N,) are finite; a box that would not be reported may be what it likes."""
        likely = np.isfinite(boxes).all(axis=1) | (scores < self.score_threshold)
        return np.isfinite(scores) & likely

    def chosen(
        self, image: NDArray[np.uint8], boxes: FloatArray, scores: FloatArray, classes: IntArray
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        """Of candidates in a picture those that detect reports."""
        likely = scores >= self.score_threshold
        boxes, scores, classes = boxes[likely], scores[likely], classes[likely]
        kept = _suppressed(boxes, scores, classes, self._ids, self.layout.nms_iou)
        height, width = image.shape[:2]
        inside = np.clip(boxes[kept], 0.0, [width, height, width, height])
        worth = scores[kept] if self._calibration is None else calibrated(scores[kept], self._calibration)
        return inside, worth, classes[kept]


def _suppressed(
    boxes: FloatArray, scores: FloatArray, classes: IntArray, ids: IntArray, nms_iou: float | None
) -> IntArray:
    """Indices of what stays of each class, by falling score; without suppression everything."""
    parts = []
    for identity in ids:
        (same,) = np.nonzero(classes == identity)
        parts.append(
            same[non_maximum_suppression(boxes[same], scores[same], 1.0 if nms_iou is None else nms_iou)]
        )
    return np.concatenate(parts)


def load_detector(
    path: Path,
    *,
    score_threshold: float,
    threads: int = 1,
    provider: str = "cpu",
    calibration: Calibration | None = None,
    layout: str | Layout | None = None,
    names: Sequence[str] | str | None = None,
    classes: Mapping[str, Sequence[str]] | None = None,
    layers: Mapping[str, int] = PERSONS,
) -> Detector:
    """Open an ONNX file of a known layout, or of the one that is described.

    names: of its classes, where its metadata does not say them. classes: which of them are which layer of
    the map, layers: the ids of these. Raises InputError if the file is missing, not ONNX, cannot be run or
    knows none of the layers; LayoutQuestionError for an unknown layout.
    """
    session = Session(path, threads, provider)
    found = recognise(session, path, asked=layout, names=known_names(names))
    groups = class_groups(found.names, classes or {}, layers, first=found.layout.first_class, where=path)
    preparation = preparation_of(found.layout, found.facts)
    return Detector(session, found.layout, preparation, groups, score_threshold, calibration, found)


def open_pool_detector(detector: PoolDetector, layers: Mapping[str, int] = PERSONS) -> Detector:
    """A detector of the pool, as the pool says that it is used. Raises InputError as load_detector does."""
    model = detector.require_model(f"{detector.id}.model")
    return load_detector(
        model,
        score_threshold=detector.score_threshold,
        calibration=detector.calibration,
        layout=detector.layout,
        names=detector.names,
        classes=detector.classes,
        layers=layers,
    )
