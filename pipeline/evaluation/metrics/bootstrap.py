"""How far chance could have moved a figure: bootstrap over sequences.

The pictures of one sequence resemble each other, so whole sequences are drawn with replacement, not pictures.
The same draws serve every cell of a grid: their differences are then paired.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.evaluation.metrics.bootstrap_kernels import weighted_precision
from pipeline.evaluation.metrics.boxes import IntArray
from pipeline.evaluation.metrics.lrp import TAU
from pipeline.evaluation.metrics.matching import Matches
from pipeline.messages import FloatArray

#: of the intervals
CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class Replicates:
    """One value for each of R draws, float64 (R,): AP .5:.95, AP .5, AR .5:.95 (at most 100 boxes), moLRP."""

    ap: FloatArray
    ap50: FloatArray
    ar100: FloatArray
    molrp: FloatArray


def drawn_weights(sequence_of_image: IntArray, replicates: int, seed: int) -> FloatArray:
    """How often each picture (I,) comes in each draw: float64 (R, I).

    sequence_of_image: int64 (I,), numbers 0, 1, ..; as many sequences are drawn as there are.
    """
    count = int(sequence_of_image.max(initial=-1)) + 1
    rng = np.random.default_rng(seed)
    drawn = (
        rng.multinomial(count, np.full(count, 1.0 / count), size=replicates)
        if count
        else np.zeros((replicates, 0))
    )
    return drawn[:, sequence_of_image].astype(np.float64)


def replicate(matches: Matches, weights: FloatArray) -> Replicates:
    """The figures of one cell under each draw; matches: at COCO's IoU thresholds, the first of them 0.5.

    A draw in which there is nothing to find gives NaN.
    """
    categories = np.unique(matches.true_category)
    each = [_of_category(matches, int(c), weights) for c in categories]
    if not each:
        nothing = np.full(len(weights), np.nan)
        return Replicates(nothing, nothing, nothing, nothing)
    ap, ap50, ar100, molrp = np.nanmean(np.array(each), axis=0)
    return Replicates(ap, ap50, ar100, molrp)


def _of_category(matches: Matches, category: int, weights: FloatArray) -> FloatArray:
    """AP, AP .5, AR and oLRP of a category: float64 (4, R)."""
    found = matches.category == category
    right, ignored = matches.right[:, found], matches.ignored[:, found]
    iou, score, image = matches.iou[0, found], matches.score[found], matches.image[found]
    true_image = matches.true_image[matches.true_category == category]
    out = np.full((4, len(weights)), np.nan)
    for r, weight in enumerate(weights):
        total = float(weight[true_image].sum())
        if total == 0.0:
            continue
        each = np.array(
            [weighted_precision(*rows, weight[image], total) for rows in zip(right, ignored, strict=True)]
        )
        lrp = _weighted_optimum(score, right[0], ignored[0], iou, weight[image], total)
        out[:, r] = each[:, 0].mean(), each[0, 0], each[:, 1].mean(), lrp
    return out


def _weighted_optimum(
    score: FloatArray,
    right: FloatArray,
    ignored: FloatArray,
    iou: FloatArray,
    weight: FloatArray,
    total: float,
) -> float:
    """Least LRP (Eq. olrp) with weighted pictures; see pipeline.evaluation.metrics.lrp."""
    counted = np.where(ignored, 0.0, weight)
    hits, kept = np.cumsum(counted * right), np.cumsum(counted)
    distance = np.cumsum(counted * right * np.maximum(1.0 - iou, 0.0)) / (1.0 - TAU)
    # only where the score changes can a threshold lie
    ends = np.flatnonzero(np.append(np.diff(score) != 0.0, True)) if len(score) else np.zeros(0, np.int64)
    lrp = (distance + kept - hits + total - hits)[ends] / (kept + total - hits)[ends]
    return float(np.append(lrp, 1.0).min())


def interval(values: FloatArray, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """The percentile interval of replicates, NaNs left out; NaN, NaN if fewer than two are left."""
    known = values[np.isfinite(values)]
    if len(known) < 2:
        return float("nan"), float("nan")
    low, high = np.quantile(known, [(1.0 - confidence) / 2.0, (1.0 + confidence) / 2.0])
    return float(low), float(high)
