"""Where a detector's scores begin to count, and what they are worth: from pictures that it has not learned from.

What one flight teaches of scores may not hold on the next. So the way from scores to probabilities is chosen
by cross-validation over flights: each rule is fitted without a flight and judged on it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config.pool import Calibration
from pipeline.evaluation.metrics.lrp import lrp_curve, optimal_lrp
from pipeline.evaluation.metrics.matching import Matches, match
from pipeline.messages import FloatArray
from pipeline.sensor.calibration import calibrated, calibration_error, fit_calibration
from pipeline.training.labelled_accuracy import HALF, LOWEST_SCORE, PERSON, Looked, counted

BoolArray = NDArray[np.bool_]
#: scores and which are right -> a calibration, or None for the scores themselves
Rule = Callable[[FloatArray, BoolArray, float], Calibration | None]


def _as_the_network_says(score: FloatArray, right: BoolArray, threshold: float) -> Calibration | None:
    return None


def _line_above_the_threshold(score: FloatArray, right: BoolArray, threshold: float) -> Calibration | None:
    return fit_calibration(score[score >= threshold], right[score >= threshold])


def _line_through_all_scores(score: FloatArray, right: BoolArray, threshold: float) -> Calibration | None:
    return fit_calibration(score, right)


RULES: dict[str, Rule] = {
    "as the network says": _as_the_network_says,
    "line above the threshold": _line_above_the_threshold,
    "line through all scores": _line_through_all_scores,
}


@dataclass(frozen=True, slots=True)
class ScoreUse:
    """threshold: where LRP is least. calibration: of the scores from there on; None: as the network says.

    rule: of RULES, the one with the least of errors: expected calibration error by cross-validation over groups.
    """

    threshold: float
    calibration: Calibration | None
    rule: str
    errors: dict[str, float]


def score_use(looked: Looked, group_key: str) -> ScoreUse:
    """Threshold and calibration from pictures that were not learned from.

    group_key: the attribute of pictures that tells the groups (flights). With one group there is nothing to
    cross-validate: the line above the threshold.
    """
    matches = match(looked.truth, looked.found, "all", HALF)
    least = optimal_lrp(lrp_curve(matches, PERSON)).threshold
    threshold = round(min(max(float(least), LOWEST_SCORE), 1.0), 2) if np.isfinite(least) else 1.0
    errors = _cross_validated(matches, _groups(looked, group_key), threshold)
    rule = min(errors, key=lambda name: errors[name]) if errors else "line above the threshold"
    score, right = counted(matches, LOWEST_SCORE)
    return ScoreUse(threshold, RULES[rule](score, right, threshold), rule, errors)


def calibration_errors(looked: Looked, use: ScoreUse) -> tuple[float, float]:
    """Expected calibration error of the reported scores, as the network says and as they are used."""
    score, right = counted(match(looked.truth, looked.found, "all", HALF), use.threshold)
    return calibration_error(score, right), calibration_error(_probabilities(score, use.calibration), right)


def _cross_validated(matches: Matches, groups: NDArray[np.int64], threshold: float) -> dict[str, float]:
    """Of each rule: fitted without each group in turn, all judged together, at the threshold."""
    counts = ~matches.ignored[0]
    score, right, group = matches.score[counts], matches.right[0, counts], groups[matches.image[counts]]
    above = score >= threshold
    if len(np.unique(groups)) < 2:
        return {}
    errors = {}
    for name, rule in RULES.items():
        said = np.empty(len(score))
        for own in np.unique(group):
            inside = group == own
            line = rule(score[~inside], right[~inside], threshold)
            said[inside] = _probabilities(score[inside], line)
        errors[name] = round(calibration_error(said[above], right[above]), 4)
    return errors


def _groups(looked: Looked, key: str) -> NDArray[np.int64]:
    names = [str(own[key]) for own in looked.attributes]
    return np.unique(names, return_inverse=True)[1].astype(np.int64)


def _probabilities(score: FloatArray, calibration: Calibration | None) -> FloatArray:
    return score if calibration is None else calibrated(score, calibration)
