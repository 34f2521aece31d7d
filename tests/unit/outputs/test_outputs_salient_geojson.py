import json
from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline.outputs.report import ReportData
from pipeline.outputs.salient_geojson import write_salient

Search = Callable[..., ReportData]


def test_a_place_is_a_point_of_longitude_latitude_height(search: Search, tmp_path: Path) -> None:
    summary = search().summary
    write_salient(tmp_path / "salient.geojson", summary.locations, summary.match)
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
