import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.fusion.error_ellipse import ellipse_of
from pipeline.fusion.salient import SalientLocation
from pipeline.outputs.accounting import StreamAccount
from pipeline.outputs.truth import MATCH_RADIUS_M, TruePerson, match_truth

SPOTS = st.lists(st.tuples(st.floats(-4, 4), st.floats(-4, 4)), max_size=5)


def place(number: int, spot: tuple[float, float]) -> SalientLocation:
    position = np.array([*spot, 0.0])
    error = ellipse_of(np.eye(2))
    return SalientLocation(number, "person", 0.9, position, 0.0, 0.0, 0.0, error, 0.1, 4, 3, 0, 1, ("s",))


def best_by_trying_all(distances: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> tuple[int, float]:
    """The greatest number of near pairs and its least total distance."""
    if distances.shape[0] > distances.shape[1]:
        distances = distances.T
    rows = range(distances.shape[0])
    best = (0, 0.0)
    for columns in itertools.permutations(range(distances.shape[1]), distances.shape[0]):
        near = [d for r, c in zip(rows, columns, strict=True) if (d := distances[r, c]) <= MATCH_RADIUS_M]
        best = max(best, (len(near), -sum(near)))
    return best[0], -best[1]


@given(SPOTS, SPOTS)
@settings(deadline=None)
def test_the_match_is_the_best_of_all(
    found: list[tuple[float, float]], true: list[tuple[float, float]]
) -> None:
    places = [place(k, spot) for k, spot in enumerate(found)]
    people = [TruePerson(str(k), np.array([spot])) for k, spot in enumerate(true)]
    match = match_truth(places, people)
    distances = np.array([[np.hypot(f[0] - t[0], f[1] - t[1]) for t in true] for f in found])
    count, total = best_by_trying_all(distances.reshape(len(found), len(true)))
    assert len(match.found) == count
    assert abs(sum(f.distance_m for f in match.found) - total) < 1e-9


@given(SPOTS, SPOTS)
@settings(deadline=None)
def test_every_place_and_every_person_is_accounted_for_once(
    found: list[tuple[float, float]], true: list[tuple[float, float]]
) -> None:
    places = [place(k, spot) for k, spot in enumerate(found)]
    people = [TruePerson(str(k), np.array([spot])) for k, spot in enumerate(true)]
    match = match_truth(places, people)
    assert sorted([*match.false, *(f.location for f in match.found)]) == list(range(len(found)))
    assert sorted([*match.missed, *(f.person for f in match.found)]) == [str(k) for k in range(len(true))]
    assert all(f.distance_m <= MATCH_RADIUS_M for f in match.found)


@given(
    st.integers(0, 50),
    st.integers(0, 50),
    st.dictionaries(st.sampled_from(["not_sampled", "link_full", "late"]), st.integers(0, 20)),
)
def test_an_account_exists_exactly_if_its_sum_holds(
    captured: int, processed: int, dropped: dict[str, int]
) -> None:
    holds = captured == processed + sum(dropped.values())
    try:
        account = StreamAccount("s", captured, processed, dropped)
    except ValueError:
        assert not holds
    else:
        assert holds
        assert account.captured == account.processed + account.dropped_total
