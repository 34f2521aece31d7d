"""The route for DJI's applications, read with libxml2 and held to a schema written after DJI's documentation."""

import io
import json
import zipfile
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from lxml import etree

from pipeline.config.second_look import DjiModel, SecondLook
from pipeline.geo.frame import LocalFrame
from pipeline.outputs.dji_route import MODELS, write_dji_route
from pipeline.outputs.second_look_files import qgc_plan
from pipeline.second_look.flight import SecondFlight, Waypoint

FRAME = LocalFrame(58.4, 15.57)
SCHEMA = Path(__file__).parents[2] / "data/dji_wpml.rng"
NAMES = {"k": "http://www.opengis.net/kml/2.2", "w": "http://www.dji.com/wpmz/1.0.2"}
#: take-off 20 m below the ground at home
FLIGHT = SecondFlight(
    (
        Waypoint(np.array([3.0, 4.0, 125.0]), 0.0, 0),
        Waypoint(np.array([9.0, 12.0, 131.9]), 4.4, 2),
        Waypoint(np.array([4.0, 5.0, 128.25]), 0.0, 1),
        Waypoint(np.array([0.0, 0.0, 124.5]), 0.0, 0),
    ),
    np.array([0.0, 0.0, 113.3]),
    60.0,
    25.0,
    (2, 1),
    takeoff_m=93.3,
    takeoff_is_told=True,
)


def written(
    tmp_path: Path, flight: SecondFlight = FLIGHT, model: DjiModel = "M3T"
) -> dict[str, etree._Element]:
    path = tmp_path / "f.kmz"
    write_dji_route(path, flight, FRAME, SecondLook(dji_model=model), 1_790_000_000_000_000_000)
    with zipfile.ZipFile(io.BytesIO(path.read_bytes())) as archive:
        assert archive.testzip() is None
        assert archive.namelist() == ["wpmz/template.kml", "wpmz/waylines.wpml"]
        return {name: etree.fromstring(archive.read(name)) for name in archive.namelist()}


def texts(element: etree._Element, path: str) -> list[str]:
    return [found.text or "" for found in element.iterfind(path, NAMES)]


@pytest.mark.parametrize("model", get_args(DjiModel))
def test_both_files_follow_the_documented_format(tmp_path: Path, model: DjiModel) -> None:
    schema = etree.RelaxNG(etree.parse(SCHEMA))
    for name, root in written(tmp_path, model=model).items():
        assert schema.validate(root), (name, schema.error_log)


def test_the_schema_refuses_what_is_not_the_format(tmp_path: Path) -> None:
    """Else the test above could not fail."""
    schema = etree.RelaxNG(etree.parse(SCHEMA))
    for path, text in (
        (".//w:executeHeightMode", "relativeToGround"),
        (".//w:executeHeight", "high"),
        (".//w:waypointTurnMode", "fly"),
        (".//w:droneEnumValue", "1"),
        (".//w:takeOffSecurityHeight", "0.5"),
    ):
        root = written(tmp_path)["wpmz/waylines.wpml"]
        next(root.iterfind(path, NAMES)).text = text
        assert not schema.validate(root), path
    root = written(tmp_path)["wpmz/waylines.wpml"]
    mark = next(root.iterfind(".//k:Placemark", NAMES))
    mark.remove(next(mark.iterfind("w:executeHeight", NAMES)))
    assert not schema.validate(root)


def test_its_way_points_are_those_of_the_flight_above_the_takeoff(tmp_path: Path) -> None:
    files = written(tmp_path)
    waylines, template = files["wpmz/waylines.wpml"], files["wpmz/template.kml"]
    assert texts(waylines, ".//w:executeHeight") == ["31.70", "38.60", "34.95", "31.20"]
    assert texts(template, ".//w:height") == ["31.70", "38.60", "34.95", "31.20"]
    assert texts(waylines, ".//w:executeHeightMode") == ["relativeToStartPoint"]
    assert texts(template, ".//w:heightMode") == ["relativeToStartPoint"]
    assert texts(waylines, ".//w:index") == ["0", "1", "2", "3"]
    for root in (waylines, template):
        degrees = np.array([t.split(",") for t in texts(root, ".//k:coordinates")], dtype=np.float64)
        east, north = FRAME.enu_from_wgs84(degrees[:, 1], degrees[:, 0])
        flown = np.array([w.position_enu[:2] for w in FLIGHT.waypoints])
        np.testing.assert_allclose(np.stack([east, north], axis=1), flown, atol=2e-3)


def test_it_climbs_first_comes_home_and_looks_down(tmp_path: Path) -> None:
    for root in written(tmp_path).values():
        assert texts(root, ".//w:takeOffSecurityHeight") == ["38.60"]
        assert texts(root, ".//w:globalRTHHeight") == ["38.60"]
        assert texts(root, ".//w:flyToWaylineMode") == ["safely"]
        assert texts(root, ".//w:finishAction") == ["goHome"]
        assert texts(root, ".//w:executeRCLostAction") == ["goBack"]
        first = next(root.iterfind(".//k:Placemark", NAMES))
        assert texts(first, ".//w:actionActuatorFunc") == ["gimbalRotate"]
        assert texts(first, ".//w:gimbalPitchRotateAngle") == ["-90"]


def test_it_hovers_in_whole_seconds_where_that_is_asked(tmp_path: Path) -> None:
    for root in written(tmp_path).values():
        marks = list(root.iterfind(".//k:Placemark", NAMES))
        assert [texts(mark, ".//w:hoverTime") for mark in marks] == [[], ["4"], [], []]
        stopping = "toPointAndStopWithDiscontinuityCurvature"
        stops = [texts(mark, ".//w:waypointTurnMode") == [stopping] for mark in marks]
        assert stops == [True, True, False, True]


def test_it_is_the_same_flight_as_qgroundcontrols(tmp_path: Path) -> None:
    plan = json.loads(json.dumps(qgc_plan(FLIGHT, FRAME, SecondLook())))
    theirs = [item["params"] for item in plan["mission"]["items"] if item["command"] == 16]
    ours = written(tmp_path)["wpmz/waylines.wpml"]
    heights = [float(h) for h in texts(ours, ".//w:executeHeight")]
    places = [[float(v) for v in t.split(",")] for t in texts(ours, ".//k:coordinates")]
    assert [p[6] for p in theirs] == pytest.approx(heights, abs=0.01)
    np.testing.assert_allclose([[p[5], p[4]] for p in theirs], places, atol=2e-8)


def test_every_model_has_numbers_of_its_own_and_the_same_flight_gives_the_same_bytes(tmp_path: Path) -> None:
    assert set(MODELS) == set(get_args(DjiModel))
    assert len(set(MODELS.values())) == len(MODELS)
    for name in "ab":
        write_dji_route(tmp_path / name, FLIGHT, FRAME, SecondLook(), 1_790_000_000_000_000_000)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
