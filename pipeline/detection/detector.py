"""A detector: a picture goes in, boxes of what is searched for come out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.config.layout import Layout
from pipeline.config.pool import Calibration, PoolDetector
from pipeline.detection.class_names import PERSON, class_groups, known_names
from pipeline.detection.decoders import decode
from pipeline.detection.model_file import require_hash
from pipeline.detection.nms import non_maximum_suppression
from pipeline.detection.preparation import Preparation
from pipeline.detection.recognition import Recognised, recognise
from pipeline.detection.session import Session
from pipeline.detection.tiles import MOST_IN_A_TILE, merged, windows_of
from pipeline.detection.trial import one_picture, preparation_of, takes_batches
from pipeline.messages import FloatArray
from pipeline.sensor.calibration import calibrated
from pipeline.sensor.setup import PLAIN, Setup, Tiling, setup_of

IntArray = NDArray[np.int64]
#: boxes (N, 4), scores (N,), class ids (N,)
Found = tuple[FloatArray, FloatArray, IntArray]
#: more tiles in one batch take more memory, not less time
TILES_AT_ONCE = 8
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
        setup: Setup = PLAIN,
        batches: bool = False,
    ) -> None:
        """classes: of each class that is reported, which of the network's are it. score_threshold: of the
        network's own scores. calibration: what the reported ones are made with. setup: as it was opened.
        batches: several tiles may be given at once.
        """
        self._session, self.layout, self.score_threshold = session, layout, score_threshold
        self._preparation, self._calibration = preparation, calibration
        self._ids = np.array(list(classes), np.int64)
        self._groups = tuple(classes.values())
        self.recognised, self.setup, self._batches = recognised, setup, batches

    @property
    def picture_size(self) -> tuple[int, int] | None:
        """Width and height in pixels that it makes of any picture; None: it looks at the picture as it is."""
        return None if self.setup.tiling is not None else self._preparation.size

    @property
    def input_size(self) -> tuple[int, int] | None:
        """Width and height of the network's input, which a picture or a tile of it is made to fit; None: any."""
        return self._preparation.size

    @property
    def class_ids(self) -> frozenset[int]:
        """Ids of the layers of the map that it knows."""
        return frozenset(self._ids.tolist())

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
        if self.setup.tiling is None:
            return self._looked([image], least)[0]
        height, width = image.shape[:2]
        windows = windows_of(width, height, self.setup.tiling)
        parts = self._in_windows(image, windows, least)
        window = np.concatenate([np.full(len(part[1]), k) for k, part in enumerate(parts)])
        boxes, scores, classes = (np.concatenate(column) for column in zip(*parts, strict=True))
        return self._merged(boxes, scores, classes, window, windows, (width, height))

    def _in_windows(self, image: NDArray[np.uint8], windows: IntArray, least: float) -> list[Found]:
        """What is found in each window, in pixels of the picture, each person once in each."""
        parts = []
        for first in range(0, len(windows), TILES_AT_ONCE):
            some = windows[first : first + TILES_AT_ONCE]
            tiles = [image[y0:y1, x0:x1] for x0, y0, x1, y1 in some.tolist()]
            for (boxes, scores, classes), (x0, y0, _, _) in zip(
                self._looked(tiles, least), some, strict=True
            ):
                kept = _suppressed(boxes, scores, classes, self._ids, self.layout.nms_iou, MOST_IN_A_TILE)
                parts.append((boxes[kept] + np.array([x0, y0, x0, y0], float), scores[kept], classes[kept]))
        return parts

    def _looked(self, images: list[NDArray[np.uint8]], least: float) -> list[Found]:
        """Candidates in each picture, in its own pixels."""
        pairs = [self._preparation.place(image) for image in images]
        placed, placements = [p for p, _ in pairs], [p for _, p in pairs]
        count = len(placed)
        if count > 1 and not (self._batches and len({p.shape for p in placed}) == 1):
            return [found for image in images for found in self._looked([image], least)]
        outputs = self._session.run(self._preparation.inputs(placed))
        size = (placed[0].shape[1], placed[0].shape[0])
        results = []
        for number, placement in enumerate(placements):
            found = decode(one_picture(outputs, number, count), size, self.layout, self._groups, least)
            results.append((placement.image_from_input(found.boxes), found.scores, self._ids[found.group]))
        return results

    def _merged(
        self,
        boxes: FloatArray,
        scores: FloatArray,
        classes: IntArray,
        window: IntArray,
        windows: IntArray,
        size: tuple[int, int],
    ) -> Found:
        """Each person once. What is not finite is left as it is, for the caller to see."""
        unusable = ~(np.isfinite(boxes).all(axis=1) & np.isfinite(scores))
        parts = [(boxes[unusable], scores[unusable], classes[unusable])]
        for identity in self._ids:
            same = (classes == identity) & ~unusable
            one, worth, _ = merged(boxes[same], scores[same], window[same], windows, size)
            parts.append((one, worth, np.full(len(worth), identity)))
        together = [np.concatenate(column) for column in zip(*parts, strict=True)]
        return together[0], together[1], together[2]

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
        if not len(scores):
            return boxes, scores, classes
        kept = _suppressed(boxes, scores, classes, self._ids, self.layout.nms_iou)
        height, width = image.shape[:2]
        inside = np.clip(boxes[kept], 0.0, [width, height, width, height])
        worth = scores[kept] if self._calibration is None else calibrated(scores[kept], self._calibration)
        return inside, worth, classes[kept]


def _suppressed(
    boxes: FloatArray,
    scores: FloatArray,
    classes: IntArray,
    ids: IntArray,
    nms_iou: float | None,
    most: int | None = None,
) -> IntArray:
    """Indices of what stays of each class, at most so many, by falling score; without suppression all of them."""
    parts = []
    for identity in ids:
        (same,) = np.nonzero(classes == identity)
        kept = non_maximum_suppression(boxes[same], scores[same], 1.0 if nms_iou is None else nms_iou)
        parts.append(same[kept[:most]])
    return np.concatenate(parts)


@dataclass(frozen=True)
class Reading:
    """How a model is read, as a row of the pool says it; see PoolDetector."""

    layout: str | Layout | None = None
    names: tuple[str, ...] | Literal["coco", "coco91"] | None = None
    classes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    input_size: tuple[int, int] | None = None
    tiling: Tiling | None = None


def load_as(path: Path, reading: Reading, *, score_threshold: float, threads: int, provider: str) -> Detector:
    """load_detector, reading a model as is said. Raises as that does."""
    return load_detector(
        path,
        score_threshold=score_threshold,
        threads=threads,
        provider=provider,
        layout=reading.layout,
        names=reading.names,
        classes=reading.classes,
        input_size=reading.input_size,
        tiling=reading.tiling,
    )


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
    input_size: tuple[int, int] | None = None,
    tiling: Tiling | None = None,
    setup: Setup | None = None,
) -> Detector:
    """Open an ONNX file of a known layout, or of the one that is described.

    names: of its classes, where its metadata does not say them. classes: which of them are which layer of
    the map, layers: the ids of these. setup: in place of threads, provider, input_size, tiling. Raises
    InputError if the file is missing, not ONNX, cannot be run or knows none of the layers;
    LayoutQuestionError for an unknown layout.
    """
    setup = setup or Setup(path.name, "", provider, threads, "", input_size, tiling)
    session = Session(path, setup.threads, setup.provider)
    found = recognise(session, path, asked=layout, names=known_names(names), size=setup.input_size)
    groups = class_groups(found.names, classes or {}, layers, first=found.layout.first_class, where=path)
    preparation = preparation_of(found.layout, found.facts)
    batches = setup.tiling is not None and takes_batches(
        session, found.layout, preparation, found.facts.picture.shape[0]
    )
    return Detector(
        session, found.layout, preparation, groups, score_threshold, calibration, found, setup, batches
    )


def open_pool_detector(
    detector: PoolDetector, layers: Mapping[str, int] = PERSONS, setup: Setup | None = None
) -> Detector:
    """A detector of the pool, run as the plan says; without a plan on one thread of the processor.

    Raises InputError as load_detector does, and for a file that is not the one that the pool was made with.
    """
    model = detector.require_model(f"{detector.id}.model")
    require_hash(model, detector.sha256)
    return load_detector(
        model,
        setup=setup or setup_of(detector),
        score_threshold=detector.score_threshold,
        calibration=detector.calibration,
        layout=detector.layout,
        names=detector.names,
        classes=detector.classes,
        layers=layers,
    )
