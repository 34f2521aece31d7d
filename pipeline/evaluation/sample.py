"""From a data set and the grid's results to cells."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.config.evaluation import Evaluation
from pipeline.evaluation.bootstrap import drawn_weights
from pipeline.evaluation.boxes import FoundBoxes, IntArray, found_boxes
from pipeline.evaluation.cell import Cell, Sample, measure, only
from pipeline.evaluation.dataset import DataSet, scaled
from pipeline.evaluation.grid import Grid
from pipeline.evaluation.unit import Condition, UnitResult

_PERSON = 1


def looked_at(grid: Grid) -> IntArray:
    """Numbers of the pictures that are looked at, rising."""
    return np.unique([n for unit in grid.units for n in unit.looked.values()]).astype(np.int64)


def sample_of(evaluation: Evaluation, dataset: DataSet, pictures: IntArray) -> Sample:
    """The truth in some pictures, at the size in which they are looked at."""
    asked = evaluation.transcoding
    truth, factors = scaled(
        dataset.truth, dataset.pictures, None if asked is None else (asked.width, asked.height)
    )
    expected = np.array([np.nan if p.expected_px is None else p.expected_px for p in dataset.pictures])
    blocks = _blocks(evaluation, dataset)[pictures]
    draws = evaluation.bootstrap
    weights = np.zeros((0, len(pictures)))
    if len(np.unique(blocks)) > 1:
        _, numbers = np.unique(blocks, return_inverse=True)
        weights = drawn_weights(numbers.reshape(-1), draws.replicates, draws.seed)
    seen = (expected * factors.mean(axis=1))[pictures]
    return Sample(len(pictures), only(truth, pictures), seen, weights)


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
    evaluation: Evaluation,
    dataset: DataSet,
    grid: Grid,
    results: dict[tuple[str, Condition], UnitResult],
    progress: Callable[[str, int, int, str], None],
) -> tuple[Cell, ...]:
    """Every detector under every condition."""
    pictures = looked_at(grid)
    sample = sample_of(evaluation, dataset, pictures)
    cells: list[Cell] = []
    total = len(evaluation.detectors) * len(grid.conditions)
    for detector in evaluation.detectors:
        for condition in grid.conditions:
            progress("metrics", len(cells), total, detector.id)
            parts = [results[q.name, condition] for q in dataset.sequences]
            found = found_in(parts, detector.id, pictures)
            cells.append(
                Cell(
                    detector=detector.id,
                    codec=condition.codec,
                    bitrate_bps=condition.bitrate_bps,
                    **_link(grid, parts, condition),
                    pictures=len(pictures),
                    **measure(sample, found, evaluation.score_cutoff),
                    not_finite=sum(part.found[detector.id].not_finite for part in parts),
                )
            )
    progress("metrics", total, total, "")
    return tuple(cells)


def found_in(parts: list[UnitResult], detector: str, pictures: IntArray) -> FoundBoxes:
    """What a detector found under one condition, in all sequences; pictures are numbered as in Sample."""
    of_parts = [part.found[detector] for part in parts]
    boxes = np.concatenate([f.boxes_px for f in of_parts])
    image = np.concatenate([f.image for f in of_parts])
    return found_boxes(
        np.searchsorted(pictures, image),
        np.full(len(image), _PERSON),
        np.hstack([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]]),
        np.concatenate([f.score for f in of_parts]),
    )


def _link(grid: Grid, parts: list[UnitResult], condition: Condition) -> dict[str, float | None]:
    """The bitrate obtained, and how long the link needs for the largest packet."""
    if condition.bitrate_bps is None:
        return {"obtained_bps": None, "largest_packet_s": None}
    rates = [u.frame_rate_hz for u in grid.units if u.condition == condition]
    seconds = sum(part.frames / rate for part, rate in zip(parts, rates, strict=True))
    largest = max(part.largest_packet_bytes for part in parts)
    return {
        "obtained_bps": 8.0 * sum(part.total_bytes for part in parts) / seconds,
        "largest_packet_s": 8.0 * largest / condition.bitrate_bps,
    }
