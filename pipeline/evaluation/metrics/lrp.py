"""Localisation Recall Precision (LRP): one error for where boxes are, what is missed and what is invented.

Oksuz et al., Localization Recall Precision (ECCV 2018) and One Metric to Measure Them All (PAMI 2021); the
paper's Equations lrp to olrp. As in their code: COCO's assignment, a box counts if its score is at least s,
and the parts are the error where it is least.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.evaluation.metrics.boxes import BoolArray, IntArray
from pipeline.evaluation.metrics.matching import Matches
from pipeline.messages import FloatArray

#: tau: overlap from which on a box is right
TAU = 0.5
#: the thresholds of the authors' code
OFFICIAL_THRESHOLDS: FloatArray = np.linspace(0.0, 1.0, 101)


@dataclass(frozen=True, eq=False)
class LrpCurve:
    """LRP at K score thresholds, rising; every array float64 (K,).

    localisation: mean of 1 - IoU of the right boxes, NaN where none is (Eq. lrp_iou). false_positive: 1 -
    precision, NaN where no box counts (Eq. lrp_fp). false_negative: 1 - recall (Eq. lrp_fn).
    """

    threshold: FloatArray
    lrp: FloatArray
    localisation: FloatArray
    false_positive: FloatArray
    false_negative: FloatArray


@dataclass(frozen=True, slots=True)
class OptimalLrp:
    """The least LRP of one category (Eq. olrp), its parts, and the score threshold it is reached at.

    All are NaN if there is nothing to find; threshold is infinite if it is best to report nothing.
    """

    lrp: float
    localisation: float
    false_positive: float
    false_negative: float
    threshold: float


_NOTHING_TO_FIND = OptimalLrp(*[float("nan")] * 5)


def lrp_curve(matches: Matches, category: int, thresholds: FloatArray | None = None) -> LrpCurve:
    """LRP (Eq. lrp2) of a category at thresholds, by default at every score and at infinity.

    matches: at the IoU threshold TAU in its first row. Empty if there is nothing to find.
    """
    counted = (matches.category == category) & ~matches.ignored[0]
    score, right = matches.score[counted], matches.right[0, counted]
    total = int(np.count_nonzero(matches.true_category == category))
    if thresholds is None:
        thresholds = np.append(np.unique(score), np.inf)
    if total == 0:
        thresholds = thresholds[:0]
    kept = len(score) - np.searchsorted(score[::-1], thresholds, side="left")
    # the sums of floats can make an overlap a little greater than 1
    distance = np.where(right, np.maximum(1.0 - matches.iou[0, counted], 0.0), 0.0)
    return _curve(thresholds, kept, _sums(right)[kept], _sums(distance)[kept], total)


def _sums(values: FloatArray | BoolArray) -> FloatArray:
    """Of the first 0, 1, .. values."""
    return np.concatenate([[0.0], np.cumsum(values, dtype=np.float64)])


def _curve(
    thresholds: FloatArray, kept: IntArray, right: FloatArray, distance: FloatArray, total: int
) -> LrpCurve:
    missed = total - right
    with np.errstate(invalid="ignore", divide="ignore"):
        return LrpCurve(
            thresholds,
            (distance / (1.0 - TAU) + (kept - right) + missed) / (kept + missed),
            distance / right,
            (kept - right) / kept,
            missed / total,
        )


def optimal_lrp(curve: LrpCurve) -> OptimalLrp:
    """Where the curve is lowest; of equal places the one with the lowest threshold."""
    if not len(curve.lrp):
        return _NOTHING_TO_FIND
    k = int(np.argmin(curve.lrp))
    return OptimalLrp(
        float(curve.lrp[k]),
        float(curve.localisation[k]),
        float(curve.false_positive[k]),
        float(curve.false_negative[k]),
        float(curve.threshold[k]),
    )


def mean_optimal_lrp(of_categories: list[OptimalLrp]) -> OptimalLrp:
    """moLRP: the mean over the categories that have something to find, part by part; threshold too."""
    rows = np.array(
        [(o.lrp, o.localisation, o.false_positive, o.false_negative, o.threshold) for o in of_categories]
    )
    return OptimalLrp(*(_mean(column) for column in rows.reshape(-1, 5).T))


def _mean(values: FloatArray) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else float("nan")


def is_at_cutoff(threshold: float, cutoff: float) -> bool:
    """Whether an optimal threshold is the detector's own cut-off, to the 0.01 of the authors' code.

    The true optimum then lies lower, where nothing was reported: the paper leaves such points out.
    """
    return threshold < cutoff + 0.01
