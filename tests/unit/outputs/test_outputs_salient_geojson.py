import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import pytest

from pipeline.geo.heights import Heights
from pipeline.outputs.report import ReportData
from pipeline.outputs.salient_geojson import write_salient

Search = Callable[..., ReportData]


def test_a_place_is_a_point_of_longitude_latitude_height(search: Search, tmp_path: Path) -> None:
    summary = search().summary
    heights = Heights("ellipsoid")
    write_salient(tmp_path / "salient.geojson", summary.locations, summary.match, heights=heights)
    collection = json.loads((tmp_path / "salient.geojson").read_text())
    assert collection["type"] == "FeatureCollection"
    assert "crs" not in collection  # RFC 7946: always WGS84
    assert [feature["id"] for feature in collection["features"]] == [1, 2, 3]
    place, feature = summary.locations[0], collection["features"][0]
    assert feature["geometry"]["type"] == "Point"
    assert feature["geometry"]["coordinates"] == pytest.approx(
        [place.longitude_deg, place.latitude_deg, place.height_m], abs=1e-8
    )
    properties = feature["properties"]
    assert properties["seen_from"] == "2026-05-01T10:00:03.000Z"
    assert properties["seen_to"] == "2026-05-01T10:00:05.000Z"
    assert properties["streams"] == ["drone-1", "drone-2"]
    assert properties["looks"] == 15
    assert (properties["height_m"], properties["height_datum"]) == (place.height_m, "ellipsoid")
    assert (properties["expected_people"], properties["may_be_same_person_as"]) == (0.97, [])


@pytest.mark.parametrize("datum", ["geoid", None])
def test_a_height_in_geojson_is_above_the_ellipsoid_or_there_is_none(
    search: Search, tmp_path: Path, datum: Literal["geoid"] | None
) -> None:
    places = search().summary.locations
    write_salient(tmp_path / "a", places, heights=Heights(datum))
    for place, feature in zip(places, json.loads((tmp_path / "a").read_text())["features"], strict=True):
        point = feature["geometry"]["coordinates"]
        assert feature["properties"]["height_datum"] == (datum or "not known")
        if datum is None:
            assert len(point) == 2
        else:  # Trondheim: the geoid is some 40 m above the ellipsoid
            assert point[2] - place.height_m == pytest.approx(40.0, abs=2.0)


def test_what_may_be_one_person_is_told(search: Search, tmp_path: Path) -> None:
    place = dataclasses.replace(search().summary.locations[0], people=2, may_be=(3,), setups=("m:nano",))
    write_salient(tmp_path / "a", [place])
    properties = json.loads((tmp_path / "a").read_text())["features"][0]["properties"]
    assert (properties["people_at_once"], properties["expected_people"]) == (2, 1.94)
    assert (properties["may_be_same_person_as"], properties["setups"]) == ([3], ["m:nano"])


def test_the_distance_to_the_truth_is_there_only_where_it_is_known(search: Search, tmp_path: Path) -> None:
    summary = search().summary
    write_salient(tmp_path / "a", summary.locations, summary.match)
    write_salient(tmp_path / "b", summary.locations)
    with_truth, without = (json.loads((tmp_path / name).read_text())["features"] for name in "ab")
    assert ["truth_distance_m" in f["properties"] for f in with_truth] == [True, True, False]
    assert not any("truth_distance_m" in f["properties"] for f in without)


def test_nothing_found_is_an_empty_collection(tmp_path: Path) -> None:
    write_salient(tmp_path / "a", ())
    document = json.loads((tmp_path / "a").read_text())
    assert (document["type"], document["features"]) == ("FeatureCollection", [])
