import numpy as np
import pytest

from pipeline.training.accuracy import Seen, accuracy

PERSON = np.array([10.0, 10.0, 30.0, 50.0])
ELSEWHERE = np.array([200.0, 10.0, 230.0, 50.0])


def seen(scores: list[float], boxes: list[np.ndarray], visible: float = 1.0) -> Seen:  # type: ignore[type-arg]
    return Seen((320, 240), PERSON[None], np.array([visible]), np.stack(boxes), np.array(scores))


def test_the_threshold_keeps_what_is_right_and_cuts_off_what_is_wrong() -> None:
    pictures = [seen([0.8, 0.4], [PERSON, ELSEWHERE]), seen([0.6, 0.3], [PERSON, ELSEWHERE])]
    assert accuracy(pictures).score == pytest.approx(0.6)


def test_a_low_right_score_is_kept_only_if_it_costs_less_than_it_brings() -> None:
    nobody = Seen((320, 240), np.zeros((0, 4)), np.zeros(0), ELSEWHERE[None], np.array([0.5]))
    wrong = [nobody] * 4
    assert accuracy([seen([0.9], [PERSON]), seen([0.2], [PERSON]), *wrong]).score == pytest.approx(0.9)


def test_a_person_hardly_visible_counts_neither_way() -> None:
    hidden = seen([0.7], [PERSON], visible=0.1)
    assert accuracy([seen([0.5], [PERSON]), hidden]).score == pytest.approx(0.5)
