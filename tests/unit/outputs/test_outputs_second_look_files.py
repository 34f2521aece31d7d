import dataclasses
import json
import math

import numpy as np
import pytest

from pipeline.config.second_look import SecondLook
from pipeline.geo.frame import LocalFrame
from pipeline.geo.heights import Heights
from pipeline.outputs.second_look_files import (
    qgc_plan,
    write_qgc_plan,
    write_second_flight,
    write_second_look,
)
from pipeline.second_look.areas import LOW_POD, SecondLookArea
from pipeline.second_look.clearance import Clearance
from pipeline.second_look.flight import SecondFlight, Waypoint

FRAME = LocalFrame(63.4, 10.4)
RING = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 5.0], [0.0, 5.0], [0.0, 0.0]])
AREA = SecondLookArea(1, {LOW_POD: 50.0}, 50.0, 0.005, (RING,), RING[:4] * 0.9)
FLIGHT = SecondFlight(
    (Waypoint(np.array([5.0, 5.0, 132.0]), 4.0, 1), Waypoint(np.array([0.0, 0.0, 130.5]), 0.0, 0)),
    np.array([0.0, 0.0, 120.0]),
    40.0,
    17.0,
    (1,),
    takeoff_m=100.0,
    takeoff_is_told=True,
    clearance=Clearance(11.5, 3.0),
)


def test_an_area_is_a_closed_polygon_with_its_reasons(tmp_path):
    write_second_look(tmp_path / "a.geojson", [AREA], FRAME)
    (feature,) = json.loads((tmp_path / "a.geojson").read_text())["features"]
    (ring,) = feature["geometry"]["coordinates"]
    assert ring[0] == ring[-1]
    east, north = FRAME.enu_from_wgs84(np.array(ring)[:, 1], np.array(ring)[:, 0])
    np.testing.assert_allclose(np.stack([east, north], axis=1), RING, atol=2e-3)
    assert feature["properties"] == {"reasons": {LOW_POD: 50.0}, "area_m2": 50.0, "worth": 0.005}


def test_an_area_of_several_pieces_is_one_feature_with_all_of_them(tmp_path):
    other = RING + np.array([30.0, 0.0])
    write_second_look(tmp_path / "a.geojson", [dataclasses.replace(AREA, further=((other,),))], FRAME)
    (feature,) = json.loads((tmp_path / "a.geojson").read_text())["features"]
    assert feature["geometry"]["type"] == "MultiPolygon"
    assert [len(rings) for rings in feature["geometry"]["coordinates"]] == [1, 1]


def test_the_flight_is_a_line_from_home_and_back(tmp_path):
    write_second_flight(tmp_path / "f.geojson", FLIGHT, FRAME, Heights("ellipsoid"))
    (feature,) = json.loads((tmp_path / "f.geojson").read_text())["features"]
    points = feature["geometry"]["coordinates"]
    assert (points[0], len(points), points[1][2]) == (points[-1], 4, 132.0)
    properties = feature["properties"]
    assert (properties["takeoff_height_m"], properties["takeoff_height_datum"]) == (100.0, "ellipsoid")
    assert properties["height_above_takeoff_m"] == [20.0, 32.0, 30.5, 20.0]
    assert (properties["least_height_above_surface_m"], properties["over_unknown_ground_m"]) == (11.5, 3.0)


def test_heights_that_nobody_knows_what_they_count_from_are_no_heights_of_geojson(tmp_path):
    write_second_flight(tmp_path / "f.geojson", FLIGHT, FRAME)
    (feature,) = json.loads((tmp_path / "f.geojson").read_text())["features"]
    assert {len(point) for point in feature["geometry"]["coordinates"]} == {2}
    assert feature["properties"]["takeoff_height_datum"] == "not known"


def test_without_areas_the_files_are_valid_and_empty(tmp_path):
    nothing = SecondFlight((), np.zeros(3), 0.0, 0.0, ())
    write_second_look(tmp_path / "a.geojson", [], FRAME)
    write_second_flight(tmp_path / "f.geojson", nothing, FRAME)
    for name in ("a", "f"):
        assert json.loads((tmp_path / f"{name}.geojson").read_text())["features"] == []


#: QGroundControl's documentation, 'Plan file format': the keys of each object and what may stand in them
PLAN = {
    "fileType": str,
    "version": int,
    "groundStation": str,
    "mission": dict,
    "geoFence": dict,
    "rallyPoints": dict,
}
MISSION = {
    "version": int,
    "firmwareType": int,
    "vehicleType": int,
    "cruiseSpeed": float,
    "hoverSpeed": float,
    "globalPlanAltitudeMode": int,
    "plannedHomePosition": list,
    "items": list,
}
ITEM = {"type": str, "autoContinue": bool, "command": int, "doJumpId": int, "frame": int, "params": list}
ALTITUDE = {"AMSLAltAboveTerrain": type(None), "Altitude": float, "AltitudeMode": int}


def follows(record, schema):
    assert set(record) == set(schema)
    for key, kind in schema.items():
        assert isinstance(record[key], kind), key


def test_the_plan_follows_the_documented_format(tmp_path):
    write_qgc_plan(tmp_path / "f.plan", FLIGHT, FRAME, SecondLook())
    plan = json.loads((tmp_path / "f.plan").read_text())
    follows(plan, PLAN)
    assert (plan["fileType"], plan["version"]) == ("Plan", 1)
    follows(plan["mission"], MISSION)
    assert plan["mission"]["version"] == 2
    for number, item in enumerate(plan["mission"]["items"], start=1):
        follows(item, ITEM | (ALTITUDE if item["frame"] == 3 else {}))
        assert (item["type"], item["doJumpId"], len(item["params"])) == ("SimpleItem", number, 7)
        assert all(p is None or math.isfinite(p) for p in item["params"])
    assert plan["geoFence"] == {"circles": [], "polygons": [], "version": 2}
    assert plan["rallyPoints"] == {"points": [], "version": 2}


def test_the_plan_takes_off_looks_down_flies_the_points_above_the_takeoff_and_returns():
    plan = qgc_plan(FLIGHT, FRAME, SecondLook())["mission"]
    assert plan["plannedHomePosition"][2] == 100.0  # the ground at home is 120 m
    items = plan["items"]
    assert [item["command"] for item in items] == [22, 178, 205, 16, 16, 20]
    assert items[0]["params"][6] == 32.0  # as high as the highest way point
    assert items[2]["params"][0] == -90
    first = items[3]["params"]
    assert (first[0], first[6]) == (4.0, 32.0)
    east, north = FRAME.enu_from_wgs84(np.array(first[4]), np.array(first[5]))
    assert (float(east), float(north)) == pytest.approx((5.0, 5.0), abs=2e-3)
