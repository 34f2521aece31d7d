"""A detector on labelled pictures, stills or frames of videos: what a row of the pool says of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from pipeline.config.pool import Calibration
from pipeline.detection import Detector
from pipeline.detection.picture_file import read_picture
from pipeline.errors import InputError
from pipeline.evaluation.datasets.coco import CocoOptions, read_coco
from pipeline.evaluation.datasets.dataset import DataSet
from pipeline.evaluation.datasets.fault_log import FaultLog
from pipeline.evaluation.metrics.boxes import FoundBoxes, found_boxes
from pipeline.evaluation.metrics.cell import Figures, figures
from pipeline.evaluation.metrics.lrp import lrp_curve, optimal_lrp
from pipeline.evaluation.metrics.matching import MOST_FOUND, Matches, match
from pipeline.ingest.video.file import decoded_frames
from pipeline.sensor.calibration import calibrated, calibration_error, fit_calibration

_PERSON = 1
#: what people call the category that is searched for
PERSON_CATEGORIES = ("person", "Person", "people", "pedestrian", "human", "swimmer")
SCORE_CUTOFF = 0.05


@dataclass(frozen=True)
class LabelledResult:
    """by_size: figures of all people and of each of COCO's size classes. threshold: where LRP is least.

    calibration: fitted to every second picture; error, error_calibrated: expected calibration error of the
    other pictures' scores, as they are and calibrated. not_finite: boxes that were NaN. faults: lines.
    """

    pictures: int
    people: int
    by_size: dict[str, Figures]
    threshold: float
    calibration: Calibration | None
    error: float
    error_calibrated: float | None
    not_finite: int
    faults: tuple[str, ...]


def labelled_pictures(labels: Path, folder: Path | None, faults: FaultLog) -> DataSet:
    """Stills or frames of videos (VIDEO#FRAME) with COCO labels.

    folder: that file names are relative to; None: the labels'. Raises InputError for what cannot be read.
    """
    options = CocoOptions(folder or labels.parent, PERSON_CATEGORIES, 0.3, None, False)
    return read_coco(labels, options, faults)


def images_of(dataset: DataSet) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """Every picture's number, and the picture, uint8 (H, W, 3) RGB. Raises InputError for one that is no picture."""
    for q in dataset.sequences:
        numbers = {dataset.pictures[n].frame: n for n in q.pictures}
        if not q.is_video:
            yield from ((n, read_picture(q.files[frame])) for frame, n in numbers.items())
        elif numbers:
            for index, frame in enumerate(islice(decoded_frames(q.files[0]), max(numbers) + 1)):
                if index in numbers:
                    yield numbers[index], cast("NDArray[np.uint8]", frame.to_ndarray(format="rgb24"))


def measure_pictures(
    detector: Detector, dataset: DataSet, faults: FaultLog, progress: Callable[[int, int], None]
) -> LabelledResult:
    """detector: opened with SCORE_CUTOFF and without calibration. progress(pictures done, of all)."""
    count = len(dataset.pictures)
    if not count:
        raise InputError("labels", "no pictures", "pictures in files of their own, or frames of videos")
    rows, not_finite = [], 0
    for done, (number, image) in enumerate(images_of(dataset)):
        progress(done, count)
        boxes, scores, classes = detector.candidates(image, SCORE_CUTOFF)
        finite = detector.finite(boxes, scores)
        not_finite += int((~finite).sum())
        boxes, scores, _ = detector.chosen(image, boxes[finite], scores[finite], classes[finite])
        rows.append((np.full(len(scores), number)[:MOST_FOUND], boxes[:MOST_FOUND], scores[:MOST_FOUND]))
    progress(count, count)
    image_of, boxes, scores = (np.concatenate(column) for column in zip(*rows, strict=True))
    xywh = np.hstack([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]])
    found = found_boxes(image_of, np.full(len(scores), _PERSON), xywh, scores)
    return _judged(dataset, found, not_finite, tuple(faults.lines()))


def _judged(dataset: DataSet, found: FoundBoxes, not_finite: int, faults: tuple[str, ...]) -> LabelledResult:
    matches = match(dataset.truth, found, "all", np.array([0.5]))
    best = optimal_lrp(lrp_curve(matches, _PERSON))
    lowest = best.threshold if np.isfinite(best.threshold) else 1.0
    threshold = round(min(max(lowest, SCORE_CUTOFF), 1.0), 2)
    calibration, error, after = _calibration(matches, threshold)
    by_size = {
        str(k): v for k, v in figures(dataset.truth, found, len(dataset.pictures), SCORE_CUTOFF).items()
    }
    people = int((~dataset.truth.crowd).sum())
    return LabelledResult(
        len(dataset.pictures), people, by_size, threshold, calibration, error, after, not_finite, faults
    )


def _calibration(matches: Matches, threshold: float) -> tuple[Calibration | None, float, float | None]:
    """Fitted to the pictures of even numbers, judged on the others."""
    counted = ~matches.ignored[0] & (matches.score >= threshold)
    score, right = matches.score[counted], matches.right[0, counted]
    fitted = matches.image[counted] % 2 == 0
    calibration = fit_calibration(score[fitted], right[fitted])
    error = calibration_error(score[~fitted], right[~fitted])
    if calibration is None:
        return None, error, None
    return calibration, error, calibration_error(calibrated(score[~fitted], calibration), right[~fitted])
