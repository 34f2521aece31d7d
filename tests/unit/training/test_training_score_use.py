"""Which way from scores to probabilities carries over to a flight that was not fitted to."""

from __future__ import annotations

import numpy as np

from pipeline.evaluation.metrics.boxes import found_boxes, true_boxes
from pipeline.training.labelled_accuracy import Looked, together
from pipeline.training.score_use import RULES, calibration_errors, score_use

PERSON, ELSEWHERE = [10, 10, 10, 20], [60, 60, 10, 20]


def flight(number: int, worth, boxes: int = 800) -> Looked:
    """A person and a box in each picture: of score s it is right with probability worth(s)."""
    rng = np.random.default_rng(number)
    scores = rng.uniform(0.05, 0.95, boxes)
    right = rng.random(boxes) < worth(scores)
    pictures = np.arange(boxes)
    places = np.where(right[:, None], PERSON, ELSEWHERE)
    return Looked(
        true_boxes(pictures, [1] * boxes, [PERSON] * boxes),
        found_boxes(pictures, [1] * boxes, places, scores),
        ({"flight": number},) * boxes,
    )


def test_looks_put_together_are_all_their_pictures():
    one, other = flight(1, lambda s: s, 5), flight(2, lambda s: s, 3)
    both = together([one, other])
    assert [own["flight"] for own in both.attributes] == [1] * 5 + [2] * 3
    assert both.truth.image.tolist() == both.found.image.tolist() == list(range(8))
    np.testing.assert_array_equal(both.found.score, [*one.found.score, *other.found.score])


def test_scores_that_are_probabilities_are_left_alone():
    looked = together([flight(k, lambda s: s) for k in range(4)])
    use = score_use(looked, "flight")
    assert set(use.errors) == set(RULES)
    assert use.errors["as the network says"] < 0.05
    before, after = calibration_errors(looked, use)
    assert after <= before + 0.01


def test_scores_that_say_too_little_on_every_flight_are_mended():
    looked = together([flight(k, lambda s: np.minimum(0.5 + s, 0.97)) for k in range(4)])
    use = score_use(looked, "flight")
    assert use.rule.startswith("line")
    assert use.errors[use.rule] < 0.06
    assert use.errors["as the network says"] > 0.2
    another = flight(9, lambda s: np.minimum(0.5 + s, 0.97))
    before, after = calibration_errors(another, use)
    assert before > 0.2
    assert after < 0.06


def test_a_line_that_one_flight_teaches_and_the_next_denies_is_not_taken():
    """By all flights together a line fits well; but none that leaves a flight out holds on it."""
    worths = [lambda s: np.minimum(s + 0.35, 1.0), lambda s: np.maximum(s - 0.35, 0.0)]
    looked = together([flight(k, worths[k]) for k in (0, 1)])
    use = score_use(looked, "flight")
    assert use.rule == "as the network says"
    assert use.calibration is None


def test_of_one_flight_there_is_nothing_to_cross_validate():
    use = score_use(flight(1, lambda s: s), "flight")
    assert use.errors == {}
    assert use.rule == "line above the threshold"
    assert use.calibration is not None
