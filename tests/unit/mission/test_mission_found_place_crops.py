"""The picture of a place is that of its surest sighting: now, and of an earlier flight."""

from __future__ import annotations

from itertools import permutations
from types import SimpleNamespace

import pytest

from pipeline.mission import found_place_crops as module
from pipeline.mission.found_place_crops import Crop, found_place_crops


def sighting(score: float, time_ns: int, stream: str = "v") -> SimpleNamespace:
    return SimpleNamespace(score=score, time_ns=time_ns, stream=stream, order=(time_ns, stream, "d", 0))


def place(number: int, *sightings: SimpleNamespace) -> SimpleNamespace:
    return SimpleNamespace(id=number, sightings=sightings)


@pytest.fixture(autouse=True)
def _cuts_nothing(monkeypatch):
    """No video: a crop for every look that was chosen."""
    cut = lambda stream, camera, looks: [Crop(p, look, b"now") for p, look in looks.items()]  # noqa: E731
    monkeypatch.setattr(module, "_cut", cut)


def mission(onto: SimpleNamespace | None = None) -> SimpleNamespace:
    streams = [SimpleNamespace(stream="v"), SimpleNamespace(stream="w")]
    return SimpleNamespace(streams=streams, cameras={"v": None, "w": None}, onto=onto)


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_the_surest_sighting_of_whatever_stream_is_shown_and_of_equals_the_first(order):
    looks = [sighting(0.4, 1), sighting(0.9, 3, "w"), sighting(0.9, 2, "v")]
    crops = found_place_crops(mission(), [place(7, *(looks[k] for k in order))])
    assert [(c.place, c.sighting.score, c.sighting.time_ns) for c in crops] == [(7, 0.9, 2)]


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_of_an_earlier_flight_the_surest_of_which_there_is_a_picture(order):
    looks = [sighting(0.3, 1, "old"), sighting(0.8, 2, "old"), sighting(0.95, 3, "old")]
    kept = SimpleNamespace(crops={looks[0].order: b"poor", looks[1].order: b"good"})
    crops = found_place_crops(mission(kept), [place(1, *(looks[k] for k in order))])
    assert [(c.sighting.score, c.png) for c in crops] == [(0.8, b"good")]


def test_a_place_that_this_flight_saw_shows_this_flight():
    old, new = sighting(0.9, 1, "old"), sighting(0.5, 9)
    kept = SimpleNamespace(crops={old.order: b"then"})
    crops = found_place_crops(mission(kept), [place(2, old), place(1, old, new)])
    assert [(c.place, c.png) for c in crops] == [(1, b"now"), (2, b"then")]
