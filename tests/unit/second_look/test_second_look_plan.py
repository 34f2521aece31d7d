import json

import numpy as np
import pytest

from pipeline.geo.frame import LocalFrame
from pipeline.geo.terrain import Terrain
from pipeline.second_look.plan import searched_cells

FRAME = LocalFrame(47.0, 8.0)
TERRAIN = Terrain(FRAME, -20.0, -20.0, 0.5, np.zeros((80, 80), dtype=np.float32))
SQUARE = np.array([[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0], [-5.0, -5.0]])


def geojson(path, ring=SQUARE, kind="Polygon"):
    latitude, longitude = FRAME.wgs84_from_enu(ring[:, 0], ring[:, 1])
    coordinates = [np.stack([longitude, latitude], axis=1).tolist()]
    path.write_text(json.dumps({"type": kind, "coordinates": coordinates}), encoding="utf-8")
    return path


def test_the_search_area_is_the_missions_polygon(tmp_path):
    inside = searched_cells(geojson(tmp_path / "area.geojson"), TERRAIN, {})
    assert inside.sum() == 400
    assert inside[30:50, 30:50].all()


def test_without_one_it_is_what_the_tracks_enclose():
    tracks = {"a": SQUARE[:2], "b": np.array([[5.0, 5.0, 30.0], [-5.0, 5.0, 30.0]])[:, :2]}
    assert searched_cells(None, TERRAIN, tracks)[30:50, 30:50].all()


@pytest.mark.parametrize("track", [np.zeros((9, 3)), np.stack([np.arange(9.0), np.arange(9.0)], axis=1)])
def test_a_drone_that_hovers_or_flies_straight_encloses_nothing(track):
    assert not searched_cells(None, TERRAIN, {"a": track}).any()


def test_a_hole_is_not_searched(tmp_path):
    latitude, longitude = FRAME.wgs84_from_enu(SQUARE[:, 0], SQUARE[:, 1])
    inner_latitude, inner_longitude = FRAME.wgs84_from_enu(0.4 * SQUARE[:, 0], 0.4 * SQUARE[:, 1])
    rings = [np.stack(p, axis=1).tolist() for p in ((longitude, latitude), (inner_longitude, inner_latitude))]
    path = tmp_path / "area.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": rings}), encoding="utf-8")
    inside = searched_cells(path, TERRAIN, {})
    assert inside.sum() == 400 - 64
    assert not inside[37:43, 37:43].any()
