"""What a score is worth: from a network's score to the probability that its box is right.

A network's scores rank its boxes, but they are no probabilities: after training with a focal loss, as ours,
they are much too low where the network is right. The sensor model (its p_det^score) needs probabilities.

Platt, Probabilistic Outputs for Support Vector Machines (1999): a straight line over the log-odds, fitted
where the truth is known.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, log_expit, logit

from pipeline.config.pool import Calibration
from pipeline.messages import FloatArray

#: scores of 0 and 1 have no log-odds, and those next to them would outweigh all others
_NEAREST_TO_CERTAIN = 1e-4
_BINS = 15


def calibrated(scores: FloatArray, calibration: Calibration) -> FloatArray:
    """Probabilities (N,) of scores (N,) in 0..1, in the same order: scale is above 0."""
    return np.asarray(expit(calibration.scale * _log_odds(scores) + calibration.offset), np.float64)


def fit_calibration(scores: FloatArray, right: NDArray[np.bool_]) -> Calibration | None:
    """The most likely line for scores (N,) of boxes of which some are right (N,).

    With Platt's targets, short of 0 and 1 by as little as the counts allow, so that it is finite even where
    the scores part right from wrong. None where it would not rise, or nothing is right or nothing is wrong.
    """
    from scipy.optimize import minimize  # slow to import, and a mission only applies what was fitted

    good, bad = int(right.sum()), int((~right).sum())
    if not good or not bad:
        return None
    target = np.where(right, (good + 1.0) / (good + 2.0), 1.0 / (bad + 2.0))
    x = _log_odds(scores)

    def loss(line: FloatArray) -> tuple[float, FloatArray]:
        z = line[0] * x + line[1]
        error = expit(z) - target
        likelihood = target * log_expit(z) + (1.0 - target) * log_expit(-z)
        return -float(likelihood.sum()), np.array([error @ x, error.sum()])

    scale, offset = minimize(loss, np.array([1.0, 0.0]), jac=True, method="BFGS").x.tolist()
    return Calibration(scale=round(scale, 4), offset=round(offset, 4)) if scale >= 1e-3 else None


def calibration_error(probabilities: FloatArray, right: NDArray[np.bool_]) -> float:
    """Expected calibration error: mean distance of probability and share of right boxes, in 15 equal bins.

    Naeini, Cooper, Hauskrecht, Obtaining Well Calibrated Probabilities Using Bayesian Binning (2015). 0 if
    there are no boxes.
    """
    bins = np.minimum((probabilities * _BINS).astype(np.int64), _BINS - 1)
    gap = np.bincount(bins, weights=probabilities - right, minlength=_BINS)
    return float(np.abs(gap).sum() / max(len(probabilities), 1))


def _log_odds(scores: FloatArray) -> FloatArray:
    return np.asarray(logit(np.clip(scores, _NEAREST_TO_CERTAIN, 1.0 - _NEAREST_TO_CERTAIN)), np.float64)
