"""What is done for units of work: encode, decode and detect."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from pipeline.detection import Detector, load_detector
from pipeline.evaluation.measuring.meter import Meter
from pipeline.evaluation.measuring.transcoding import looked_at
from pipeline.evaluation.measuring.unit import Unit
from pipeline.evaluation.metrics.boxes import IntArray
from pipeline.evaluation.metrics.matching import MOST_FOUND
from pipeline.messages import FloatArray


@dataclass(frozen=True, eq=False)
class Found:
    """What one detector found: image int64 (N,), boxes_px float64 (N, 4) xyxy, score float64 (N,).

    not_finite: detections that were NaN or infinite, and are left out.
    """

    image: IntArray
    boxes_px: FloatArray
    score: FloatArray
    not_finite: int
    detect_s: float


@dataclass(frozen=True, eq=False)
class UnitResult:
    """total_bytes: of all packets. frames: encoded. seconds: spent on each part of the work."""

    total_bytes: int
    largest_packet_bytes: int
    frames: int
    seconds: dict[str, float]
    found: dict[str, Found]


def work(units: tuple[Unit, ...]) -> tuple[UnitResult, ...]:
    """Encode, decode and detect for units of one sequence, whose source is decoded once.

    Raises InputError for files that cannot be read or encoded.
    """
    started, meters = time.perf_counter(), [Meter() for _ in units]
    scanners = [_scanners(unit, meter) for unit, meter in zip(units, meters, strict=True)]
    for k, frame, picture in looked_at(units, meters):
        with meters[k].spending("convert"):
            image = cast("NDArray[np.uint8]", frame.to_ndarray(format="rgb24"))
        for scanner in scanners[k].values():
            with meters[k].spending("detect"):
                scanner.look(image, picture)
    rest = time.perf_counter() - started - sum(sum(meter.seconds.values()) for meter in meters)
    results = []
    for unit, meter, own in zip(units, meters, scanners, strict=True):
        meter.spend("other", rest / len(units))
        found = {name: scanner.found() for name, scanner in own.items()}
        results.append(UnitResult(meter.total_bytes, meter.largest, len(unit.kept), meter.seconds, found))
    return tuple(results)


def _scanners(unit: Unit, meter: Meter) -> dict[str, _Scanner]:
    with meter.spending("load"):
        return {m.id: _Scanner(_opened(m.path, m.provider, unit.score_cutoff)) for m in unit.models}


def first_pictures(unit: Unit, count: int) -> list[NDArray[np.uint8]]:
    """The first pictures that are looked at, uint8 (H, W, 3) RGB, as a detector gets them."""
    frames = islice(looked_at((unit,), [Meter()]), count)
    return [cast("NDArray[np.uint8]", frame.to_ndarray(format="rgb24")) for _, frame, _ in frames]


@lru_cache(maxsize=32)
def _opened(path: Path, provider: str, score_cutoff: float) -> Detector:
    return load_detector(path, score_threshold=score_cutoff, provider=provider)


class _Scanner:
    """One detector, and what it has found so far."""

    def __init__(self, detector: Detector) -> None:
        self._detector = detector
        self._rows: list[tuple[int, FloatArray, FloatArray]] = []
        self._not_finite = 0
        self._seconds = 0.0

    def look(self, image: NDArray[np.uint8], picture: int) -> None:
        started = time.perf_counter()
        boxes, scores, classes = self._detector.candidates(image)
        finite = self._detector.finite(boxes, scores)
        self._not_finite += int((~finite).sum())
        boxes, scores, _ = self._detector.chosen(image, boxes[finite], scores[finite], classes[finite])
        # they come by falling score, and no metric takes more
        self._rows.append((picture, boxes[:MOST_FOUND], scores[:MOST_FOUND]))
        self._seconds += time.perf_counter() - started

    def found(self) -> Found:
        pictures = [np.full(len(scores), picture, np.int64) for picture, _, scores in self._rows]
        return Found(
            np.concatenate([np.zeros(0, np.int64), *pictures]),
            np.concatenate([np.zeros((0, 4)), *(boxes for _, boxes, _ in self._rows)]),
            np.concatenate([np.zeros(0), *(scores for _, _, scores in self._rows)]),
            self._not_finite,
            self._seconds,
        )
