"""From what the grid's units found to cells and to one score threshold for each detector."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from pipeline.config.evaluation import Evaluation
from pipeline.config.pool import Calibration
from pipeline.evaluation.datasets.dataset import DataSet, scaled
from pipeline.evaluation.measuring.grid import Grid
from pipeline.evaluation.measuring.unit import Condition
from pipeline.evaluation.measuring.work_unit import UnitResult
from pipeline.evaluation.metrics.bootstrap import drawn_weights
from pipeline.evaluation.metrics.boxes import FoundBoxes, IntArray, found_boxes, true_boxes
from pipeline.evaluation.metrics.cell import Cell, Sample, measure, only
from pipeline.evaluation.metrics.lrp import lrp_curve, optimal_lrp
from pipeline.evaluation.metrics.matching import Matches, match
from pipeline.sensor.calibration import calibrated, calibration_error, fit_calibration

_PERSON = 1


@dataclass(frozen=True, eq=False)
class GridResults:
    """A finished grid. by_unit: by sequence and condition."""

    evaluation: Evaluation
    dataset: DataSet
    grid: Grid
    by_unit: dict[tuple[str, Condition], UnitResult]

    @cached_property
    def pictures(self) -> IntArray:
        """Numbers of the pictures that are looked at, rising."""
        return np.unique([n for unit in self.grid.units for n in unit.looked.values()]).astype(np.int64)

    @cached_property
    def sample(self) -> Sample:
        """The truth in those pictures, at the size in which they are looked at."""
        asked, dataset = self.evaluation.transcoding, self.dataset
        size = None if asked is None else (asked.width, asked.height)
        truth, factors = scaled(dataset.truth, dataset.pictures, size)
        expected = np.array([np.nan if p.expected_px is None else p.expected_px for p in dataset.pictures])
        seen = (expected * factors.mean(axis=1))[self.pictures]
        _, blocks = np.unique(_blocks(self.evaluation, dataset)[self.pictures], return_inverse=True)
        blocks, draws = blocks.reshape(-1), self.evaluation.bootstrap
        several = int(blocks.max(initial=0)) > 0
        weights = drawn_weights(blocks, draws.replicates if several else 0, draws.seed)
        return Sample(len(self.pictures), only(truth, self.pictures), seen, weights)

    def parts(self, condition: Condition) -> list[UnitResult]:
        """Of all sequences, under one condition."""
        return [self.by_unit[q.name, condition] for q in self.dataset.sequences]

    def found(self, detector: str, condition: Condition) -> FoundBoxes:
        """What a detector found under one condition; pictures are numbered as in the sample."""
        of_parts = [part.found[detector] for part in self.parts(condition)]
        boxes = np.concatenate([f.boxes_px for f in of_parts])
        image = np.concatenate([f.image for f in of_parts])
        return found_boxes(
            np.searchsorted(self.pictures, image),
            np.full(len(image), _PERSON),
            np.hstack([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]]),
            np.concatenate([f.score for f in of_parts]),
        )

    def seconds(self) -> dict[str, float]:
        """What the grid's cells took, by part."""
        spent: dict[str, float] = {}
        for result in self.by_unit.values():
            parts = result.seconds | {"detect": sum(f.detect_s for f in result.found.values())}
            for part, seconds in parts.items():
                spent[part] = spent.get(part, 0.0) + seconds
        return spent


def _blocks(evaluation: Evaluation, dataset: DataSet) -> IntArray:
    """What each picture is drawn with: its sequence, or its piece of it."""
    block_s, blocks, first = evaluation.bootstrap.block, np.zeros(len(dataset.pictures), np.int64), 0
    for q in dataset.sequences:
        frames = np.array([dataset.pictures[n].frame for n in q.pictures])
        piece = np.zeros(len(frames), np.int64)
        if block_s is not None and q.frame_rate is not None:
            piece = (frames / (q.frame_rate * block_s)).astype(np.int64)
        blocks[list(q.pictures)] = first + piece
        first += int(piece.max(initial=0)) + 1
    return blocks


def cells_of(
    results: GridResults, progress: Callable[[str, int, int, str], None], workers: int = 1
) -> tuple[Cell, ...]:
    """Every detector under every condition; so many at once."""
    jobs = [(d.id, c) for d in results.evaluation.detectors for c in results.grid.conditions]
    _ = results.sample  # made once, before the threads want it
    cells = []
    # threads: the kernels and the library of COCO's metrics let others work meanwhile
    with ThreadPoolExecutor(workers) as pool:
        for k, cell in enumerate(pool.map(partial(_cell, results), *zip(*jobs, strict=True))):
            progress("metrics", k, len(jobs), cell.detector)
            cells.append(cell)
    progress("metrics", len(jobs), len(jobs), "")
    return tuple(cells)


def _cell(results: GridResults, detector: str, condition: Condition) -> Cell:
    found = results.found(detector, condition)
    return Cell(
        detector=detector,
        codec=condition.codec,
        bitrate_bps=condition.bitrate_bps,
        **_link(results, condition),
        pictures=results.sample.images,
        **measure(results.sample, found, results.evaluation.score_cutoff),
        not_finite=sum(part.found[detector].not_finite for part in results.parts(condition)),
    )


def _link(results: GridResults, condition: Condition) -> dict[str, float | None]:
    """The bitrate obtained, and how long the link needs for the largest packet."""
    if condition.bitrate_bps is None:
        return {"obtained_bps": None, "largest_packet_s": None}
    parts = results.parts(condition)
    rates = [u.frame_rate_hz for u in results.grid.units if u.condition == condition]
    seconds = sum(part.frames / rate for part, rate in zip(parts, rates, strict=True))
    largest = max(part.largest_packet_bytes for part in parts)
    return {
        "obtained_bps": 8.0 * sum(part.total_bytes for part in parts) / seconds,
        "largest_packet_s": 8.0 * largest / condition.bitrate_bps,
    }


@dataclass(frozen=True, slots=True)
class ScoreUse:
    """How a detector's scores are to be used, judged over all conditions together.

    threshold: where LRP is least, never below the cut-off; two decimals. calibration: of the boxes above it.
    Both as given, if the evaluation file gives them.
    error, error_calibrated: expected calibration error of those boxes' scores as they are, and calibrated.
    """

    threshold: float
    calibration: Calibration | None
    error: float
    error_calibrated: float | None


def score_use(results: GridResults, detector: str) -> ScoreUse:
    """See ScoreUse."""
    matches = _all_matches(results, detector)
    given = next(d for d in results.evaluation.detectors if d.id == detector)
    threshold = given.score_threshold
    if threshold is None:
        best = optimal_lrp(lrp_curve(matches, _PERSON))
        threshold = round(min(max(best.threshold, results.evaluation.score_cutoff), 1.0), 2)
    counted = ~matches.ignored[0] & (matches.score >= threshold)
    score, right = matches.score[counted], matches.right[0, counted]
    chosen_here = given.score_threshold is None
    calibration = fit_calibration(score, right) if chosen_here else given.calibration
    after = None if calibration is None else calibration_error(calibrated(score, calibration), right)
    return ScoreUse(threshold, calibration, calibration_error(score, right), after)


def _all_matches(results: GridResults, detector: str) -> Matches:
    """At IoU 0.5, the pictures of every condition one after the other."""
    count, truth, images = len(results.grid.conditions), results.sample.truth, results.sample.images
    true = true_boxes(
        np.concatenate([truth.image + k * images for k in range(count)]),
        np.tile(truth.category, count),
        np.tile(truth.bbox, (count, 1)),
        np.tile(truth.area, count),
        np.tile(truth.crowd, count),
    )
    parts = [results.found(detector, condition) for condition in results.grid.conditions]
    found = found_boxes(
        np.concatenate([part.image + k * images for k, part in enumerate(parts)]),
        np.concatenate([part.category for part in parts]),
        np.concatenate([part.bbox for part in parts]),
        np.concatenate([part.score for part in parts]),
    )
    return match(true, found, "all", np.array([0.5]))
