import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic_search import FRAME, location, standing

from pipeline.errors import InputError
from pipeline.outputs.truth import distance_to_track_m, load_truth, match_truth


def feature(kind: str, coordinates: Any, **rest: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, **rest}


def written(path: Path, *features: Any) -> Path:
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def test_each_person_is_found_once() -> None:
    match = match_truth([location(1, 0, 0), location(2, 0.5, 0)], [standing("a", 0.1, 0)])
    assert [(f.location, f.person) for f in match.found] == [(1, "a")]
    assert match.false == (2,)
    assert match.missed == ()


def test_as_many_people_as_possible_come_before_near_ones() -> None:
    # greedy would give place 1 to b, and leave a and place 2 alone
    match = match_truth(
        [location(1, 0, 0), location(2, 1.8, 0)], [standing("a", -1.5, 0), standing("b", 0.1, 0)]
    )
    assert {(f.location, f.person) for f in match.found} == {(1, "a"), (2, "b")}
    assert match.mean_distance_m == pytest.approx((1.5 + 1.7) / 2)


def test_the_radius_is_part_of_it() -> None:
    assert match_truth([location(1, 2.0, 0)], [standing("a", 0, 0)]).people == 1
    assert match_truth([location(1, 2.0, 0)], [standing("a", 0, 0)]).missed == ()
    assert match_truth([location(1, 2.001, 0)], [standing("a", 0, 0)]).missed == ("a",)


def test_nobody_found_has_no_mean() -> None:
    match = match_truth([], [standing("a", 0, 0)])
    assert (match.people, match.mean_distance_m, match.missed) == (1, None, ("a",))
    assert match_truth([location(1, 0, 0)], []).false == (1,)


def test_the_distance_to_a_walker_is_that_to_the_track() -> None:
    track = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    assert distance_to_track_m(np.array([5.0, 1.0, 99.0]), track) == pytest.approx(1.0)
    assert distance_to_track_m(np.array([-3.0, 4.0]), track) == pytest.approx(5.0)
    assert distance_to_track_m(np.array([8.0, 12.0]), track) == pytest.approx(8**0.5)
    assert distance_to_track_m(np.array([3.0, 4.0]), np.zeros((1, 2))) == pytest.approx(5.0)
    assert distance_to_track_m(np.array([3.0, 4.0]), np.zeros((3, 2))) == pytest.approx(5.0)


def test_points_and_lines_are_read_in_degrees(tmp_path: Path) -> None:
    latitude, longitude = FRAME.wgs84_from_enu(np.array([3.0, 5.0]), np.array([4.0, 6.0]))
    line = [[longitude[0], latitude[0], 120.0], [longitude[1], latitude[1]]]
    path = written(
        tmp_path / "people.geojson",
        feature("Point", line[0], id=7, properties=None),
        feature("LineString", line, properties={"id": "walker"}),
        feature("Point", line[1], properties={}),
    )
    people = load_truth(path, FRAME)
    assert [person.id for person in people] == ["7", "walker", "3"]
    np.testing.assert_allclose(people[0].track_enu, [[3.0, 4.0]], atol=1e-6)
    np.testing.assert_allclose(people[1].track_enu, [[3.0, 4.0], [5.0, 6.0]], atol=1e-6)


@pytest.mark.parametrize(
    "features",
    [
        [feature("Polygon", [[[0, 0], [1, 1], [0, 1]]])],
        [feature("Point", [200.0, 0.0])],
        [feature("Point", [float("nan"), 0.0])],
        [feature("Point", ["a", 0.0])],
        [feature("Point", [1.0])],
        [feature("LineString", [])],
        [{"type": "Feature", "geometry": None}],
        [1],
    ],
)
def test_what_is_no_place_is_an_input_error(tmp_path: Path, features: list[Any]) -> None:
    with pytest.raises(InputError) as caught:
        load_truth(written(tmp_path / "people.geojson", *features), FRAME)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "[]", "{}", "[" * 100_000, '{"features": 3}', "\ud800"])
def test_what_is_no_geojson_is_an_input_error(tmp_path: Path, text: str) -> None:
    path = tmp_path / "people.geojson"
    path.write_text(text, encoding="utf-8", errors="surrogatepass")
    with pytest.raises(InputError):
        load_truth(path, FRAME)


def test_a_missing_file_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no file"):
        load_truth(tmp_path / "people.geojson", FRAME)
