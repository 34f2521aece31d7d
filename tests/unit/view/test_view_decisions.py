"""What reviewers decide: kept over a power cut, taken back without a trace, theirs though places are renumbered."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.view.decisions import FILE, append, decided_probability, net_votes, read_log
from pipeline.view.layer import Layer
from pipeline.view.pictures import layer_png, with_votes
from pipeline.view.places import places_of, with_decisions

FRAME = LocalFrame(47.0, 8.0)
AT = "2026-12-01T10:00:00.000Z"


def geojson(*places: tuple[int, float, float, float]) -> bytes:
    """id, east, north, probability."""
    features = []
    for number, east, north, probability in places:
        latitude, longitude = FRAME.wgs84_from_enu(np.array(east), np.array(north))
        properties = {
            "class": "person",
            "probability": probability,
            "error_ellipse": {"semi_major_m": 2.0, "semi_minor_m": 1.0, "orientation_deg": 30.0},
        }
        geometry = {"type": "Point", "coordinates": [float(longitude), float(latitude)]}
        features.append({"id": number, "geometry": geometry, "properties": properties})
    return json.dumps({"features": features}).encode()


def say(run: Path, kind: str, east: float, north: float, who: str = "Ana", **more: Any) -> int:
    latitude, longitude = FRAME.wgs84_from_enu(np.array(east), np.array(north))
    where = {"latitude_deg": float(latitude), "longitude_deg": float(longitude)}
    said = {"who": who, "kind": kind, "place": 1, "class_name": "person"} | where | more
    return append(run, AT, said).number


def test_each_confirmation_is_a_likelihood_ratio_of_19() -> None:
    assert decided_probability(0.5, 1) == pytest.approx(0.95)
    assert decided_probability(0.5, -1) == pytest.approx(0.05)
    assert decided_probability(0.2, 1) == pytest.approx(0.2 * 19 / (0.2 * 19 + 0.8))
    assert decided_probability(0.2, 2) == pytest.approx(0.2 * 361 / (0.2 * 361 + 0.8))
    assert decided_probability(0.123456789, 0) == 0.123456789
    assert 0.0 < decided_probability(0.0, 1) < 1e-6
    assert math.isfinite(decided_probability(1.0, -3))


def test_a_decision_survives_and_is_taken_back(tmp_path: Path) -> None:
    number = say(tmp_path, "confirm", 0.0, 0.0)
    assert [d.kind for d in read_log(tmp_path).standing] == ["confirm"]
    assert say(tmp_path, "undo", 0.0, 0.0, undoes=number) == 2
    assert read_log(tmp_path).standing == ()
    assert len(read_log(tmp_path).decisions) == 2  # nothing is ever removed
    with pytest.raises(InputError, match="undoes"):
        say(tmp_path, "undo", 0.0, 0.0, undoes=number)


@pytest.mark.parametrize(
    "said",
    [
        {"kind": "destroy"},
        {"who": ""},
        {"who": "x" * 41},
        {"who": 7},
        {"kind": "note", "text": "  "},
        {"kind": "note", "text": "x" * 501},
        {"kind": "undo", "undoes": 99},
    ],
)
def test_what_is_no_decision_is_not_written(tmp_path: Path, said: dict) -> None:
    with pytest.raises(InputError):
        say(tmp_path, **({"kind": "confirm", "east": 0.0, "north": 0.0} | said))
    assert read_log(tmp_path).decisions == ()


def test_nobody_takes_back_what_another_decided(tmp_path: Path) -> None:
    number = say(tmp_path, "reject", 0.0, 0.0, "Ana")
    with pytest.raises(InputError, match="same reviewer"):
        say(tmp_path, "undo", 0.0, 0.0, "Ben", undoes=number)


@pytest.mark.parametrize("cut", [1, 20, 90])
def test_a_line_that_a_power_cut_has_cut_off_is_said_and_swallows_nothing(tmp_path: Path, cut: int) -> None:
    say(tmp_path, "confirm", 0.0, 0.0)
    say(tmp_path, "reject", 50.0, 0.0)
    whole = (tmp_path / FILE).read_bytes()
    (tmp_path / FILE).write_bytes(whole[:-cut] if cut > 1 else whole[:-2])
    assert read_log(tmp_path).unreadable == 1
    assert say(tmp_path, "confirm", 9.0, 0.0) == 2
    assert [d.kind for d in read_log(tmp_path).standing] == ["confirm", "confirm"]


def test_decisions_follow_their_place_when_it_gets_another_number(tmp_path: Path) -> None:
    say(tmp_path, "confirm", 10.0, 0.0)
    say(tmp_path, "reject", 80.0, 0.0)
    places = places_of(geojson((1, 40.0, 0.0, 0.8), (2, 10.6, 0.4, 0.8)), None, None, FRAME)
    decided, lost = with_decisions(places, read_log(tmp_path).standing, FRAME)
    assert [p.net for p in decided] == [0, 1]
    assert decided[1].decided > 0.98
    assert [d.kind for d in lost] == ["reject"]  # said, not lost
    back, lost = with_decisions(
        places_of(geojson((5, 80.0, 0.0, 0.8)), None, None, FRAME), read_log(tmp_path).standing, FRAME
    )
    assert back[0].net == -1
    assert [d.kind for d in lost] == ["confirm"]


def test_two_reviewers_count_both_and_a_contradiction_is_said(tmp_path: Path) -> None:
    places = places_of(geojson((1, 0.0, 0.0, 0.6)), None, None, FRAME)
    say(tmp_path, "confirm", 0.0, 0.0, "Ana")
    say(tmp_path, "confirm", 0.0, 0.0, "Ben")
    assert net_votes(read_log(tmp_path).standing) == 2
    say(tmp_path, "reject", 0.0, 0.0, "Ben")  # his later word counts
    (place,), _ = with_decisions(places, read_log(tmp_path).standing, FRAME)
    assert place.net == 0
    assert place.conflict
    assert place.decided == 0.6
    say(tmp_path, "reject", 0.0, 0.0, "Ana")
    (place,), _ = with_decisions(places, read_log(tmp_path).standing, FRAME)
    assert (place.net, place.conflict) == (-2, False)


def test_the_map_changes_about_the_place_only_and_undo_gives_the_same_bytes(tmp_path: Path) -> None:
    probability = np.full((40, 60), 100, dtype=np.uint8)
    probability[:, :10] = 0
    layer = Layer(-30.0, -20.0, 1.0, probability, probability)
    places = places_of(geojson((1, 0.0, 0.0, 0.6), (2, 20.0, 10.0, 0.6)), None, None, FRAME)
    before = layer_png(with_votes(layer, places), "probability")
    number = say(tmp_path, "confirm", 0.0, 0.0)
    decided, _ = with_decisions(places, read_log(tmp_path).standing, FRAME)
    changed = with_votes(layer, decided).probability
    rows, columns = np.nonzero(changed != probability)
    assert 4 <= len(rows) <= 12  # an ellipse of 2 x 1 m
    assert np.hypot(rows + 0.5 - 20.0, columns + 0.5 - 30.0).max() <= 2.0
    p = 99 / 254
    assert changed[20, 30] == 1 + round(254 * p * 19 / (p * 19 + 1 - p))
    assert layer_png(with_votes(layer, decided), "probability") != before
    say(tmp_path, "undo", 0.0, 0.0, undoes=number)
    undone, _ = with_decisions(places, read_log(tmp_path).standing, FRAME)
    assert layer_png(with_votes(layer, undone), "probability") == before


def test_where_nobody_looked_no_decision_makes_a_look() -> None:
    nobody = np.zeros((4, 4), dtype=np.uint8)
    layer = Layer(-2.0, -2.0, 1.0, nobody, nobody)
    (place,) = places_of(geojson((1, 0.0, 0.0, 0.6)), None, None, FRAME)
    confirmed = type(place)(**{**vars(place), "decisions": ()})
    assert (with_votes(layer, (confirmed,)).probability == 0).all()
