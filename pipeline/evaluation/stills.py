"""A detector on labelled stills: what a row of the pool says of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

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
from pipeline.sensor.calibration import calibrated, calibration_error, fit_calibration

_PERSON = 1
#: what people call the category that is searched for
PERSON_CATEGORIES = ("person", "Person", "people", "pedestrian", "human", "swimmer")
SCORE_CUTOFF = 0.05


@dataclass(frozen=True)
class StillsResult:
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


def labelled_stills(labels: Path, folder: Path | None, faults: FaultLog) -> DataSet:
    """Pictures with COCO labels. folder: that file names are relative to; None: the labels'.

    Raises InputError for labels or pictures that cannot be read.
    """
    options = CocoOptions(folder or labels.parent, PERSON_CATEGORIES, 0.3, None, False)
    return read_coco(labels, options, faults)


def measure_stills(
    detector: Detector, dataset: DataSet, faults: FaultLog, progress: Callable[[int, int], None]
) -> StillsResult:
    """detector: opened with SCORE_CUTOFF and without calibration. progress(pictures done, of all)."""
    files = [
        (n, q.files[dataset.pictures[n].frame])
        for q in dataset.sequences
        if not q.is_video
        for n in q.pictures
    ]
    if not files:
        raise InputError("labels", "no still pictures", "pictures in files of their own")
    rows, not_finite = [], 0
    for done, (number, file) in enumerate(files):
        progress(done, len(files))
        image = read_picture(file)
        boxes, scores, classes = detector.candidates(image, SCORE_CUTOFF)
        finite = detector.finite(boxes, scores)
        not_finite += int((~finite).sum())
        boxes, scores, _ = detector.chosen(image, boxes[finite], scores[finite], classes[finite])
        rows.append((np.full(len(scores), number)[:MOST_FOUND], boxes[:MOST_FOUND], scores[:MOST_FOUND]))
    progress(len(files), len(files))
    image_of, boxes, scores = (np.concatenate(column) for column in zip(*rows, strict=True))
    xywh = np.hstack([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]])
    found = found_boxes(image_of, np.full(len(scores), _PERSON), xywh, scores)
    return _judged(dataset, found, not_finite, tuple(faults.lines()))


def _judged(dataset: DataSet, found: FoundBoxes, not_finite: int, faults: tuple[str, ...]) -> StillsResult:
    matches = match(dataset.truth, found, "all", np.array([0.5]))
    best = optimal_lrp(lrp_curve(matches, _PERSON))
    lowest = best.threshold if np.isfinite(best.threshold) else 1.0
    threshold = round(min(max(lowest, SCORE_CUTOFF), 1.0), 2)
    calibration, error, after = _calibration(matches, threshold)
    by_size = {
        str(k): v for k, v in figures(dataset.truth, found, len(dataset.pictures), SCORE_CUTOFF).items()
    }
    people = int((~dataset.truth.crowd).sum())
    return StillsResult(
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
