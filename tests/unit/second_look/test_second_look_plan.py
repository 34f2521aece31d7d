import json

import numpy as np
import pytest

from pipeline.config.second_look import SecondLook
from pipeline.fusion.voxel_map import VoxelMap
from pipeline.geo.frame import LocalFrame
from pipeline.geo.terrain import Terrain
from pipeline.second_look.cells import cells_inside
from pipeline.second_look.plan import plan_second_look, wanted_ground

FRAME = LocalFrame(47.0, 8.0)
TERRAIN = Terrain(FRAME, -20.0, -20.0, 0.5, np.zeros((80, 80), dtype=np.float32))
SQUARE = np.array([[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0], [-5.0, -5.0]])


def geojson(path, ring=SQUARE, kind="Polygon"):
    latitude, longitude = FRAME.wgs84_from_enu(ring[:, 0], ring[:, 1])
    coordinates = [np.stack([longitude, latitude], axis=1).tolist()]
    path.write_text(json.dumps({"type": kind, "coordinates": coordinates}), encoding="utf-8")
    return path


def searched_cells(area, terrain, tracks):
    return cells_inside(wanted_ground(area, terrain, tracks, SecondLook()), terrain)


def test_the_search_area_is_the_missions_polygon(tmp_path):
    inside = searched_cells(geojson(tmp_path / "area.geojson"), TERRAIN, {})
    assert inside.sum() == 400
    assert inside[30:50, 30:50].all()


def test_without_one_it_is_what_the_tracks_enclose():
    tracks = {"a": SQUARE[:2], "b": np.array([[5.0, 5.0, 30.0], [-5.0, 5.0, 30.0]])[:, :2]}
    assert searched_cells(None, TERRAIN, tracks)[30:50, 30:50].all()


def wandering(track, sd_m):
    return track + np.random.default_rng(5).normal(0.0, sd_m, track.shape)


LEG = np.stack([np.linspace(-15.0, 15.0, 60), np.linspace(-10.0, 12.0, 60)], axis=1)
ENCLOSE_NOTHING = [
    np.zeros((9, 3)),
    np.stack([np.arange(9.0), np.arange(9.0)], axis=1),
    LEG[:1],
    wandering(LEG, 0.5),
    wandering(np.zeros((60, 2)), 1.5),
    np.concatenate([LEG, LEG[::-1] + np.array([1.0, -1.0])]),  # there and back
]


@pytest.mark.parametrize("track", ENCLOSE_NOTHING)
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


def seen_map(rows=slice(0, 80), columns=slice(0, 80), terrain=TERRAIN):
    """A map whose cells in a window were seen well, and nobody there."""
    voxel_map = VoxelMap(terrain, 0.1192, 0.971)
    inside = np.zeros(terrain.shape, dtype=bool)
    inside[rows, columns] = True
    cells = np.nonzero(inside)
    voxel_map.update(*cells, np.full(len(cells[0]), -1.5))
    flat = voxel_map.tiles.flat(*cells)
    for name, value in (("looks", 2), ("resolution_px", 1280), ("pod_look", 0.9)):
        voxel_map.tiles.cells[name][flat] = value
    return voxel_map


def planned(params, camera, voxel_map, tracks, area=None):
    return plan_second_look(voxel_map, voxel_map.terrain, params, camera, tracks, area)


@pytest.mark.parametrize("track", [wandering(LEG, 0.5), np.zeros((9, 2))], ids=["a straight leg", "a hover"])
def test_a_flight_that_encloses_nothing_is_not_judged(params, camera, track):
    coverage = planned(params, camera, seen_map(), {"a": track}).coverage
    assert (coverage.basis, coverage.is_complete) == ("none", False)
    (sentence,) = coverage.sentences
    assert sentence.startswith("Not judged")
    assert coverage.seen_m2 == 1600.0


def test_all_that_the_ways_enclose_was_looked_at(params, camera):
    coverage = planned(params, camera, seen_map(), {"a": SQUARE}).coverage
    assert (coverage.basis, coverage.is_complete, coverage.sentences) == ("ways", True, ())
    assert (coverage.wanted_m2, coverage.judged_m2, coverage.looked_m2) == (100.0, 100.0, 100.0)


def test_what_nobody_looked_at_is_told(params, camera, tmp_path):
    area = geojson(tmp_path / "area.geojson")
    plan = planned(params, camera, seen_map(columns=slice(0, 45)), {"a": SQUARE}, area)
    assert (plan.coverage.basis, plan.coverage.looked_m2, plan.coverage.unseen_m2) == ("area", 75.0, 25.0)
    assert plan.coverage.sentences == ("Nobody looked at 25 of 100 square metres of the search area.",)
    assert [sum(a.reasons.values()) for a in plan.areas] == [25.0]


@pytest.mark.parametrize("gap", ["beyond", "hole"])
def test_what_lies_off_the_known_terrain_is_not_judged(params, camera, tmp_path, gap):
    heights = np.zeros((80, 80), dtype=np.float32)
    terrain = Terrain(FRAME, -20.0, -20.0, 0.5, heights)
    if gap == "hole":
        heights[30:50, 40:] = np.nan
    else:
        terrain = Terrain(FRAME, -20.0, -20.0, 0.5, heights[:, :40].copy())
    area = geojson(tmp_path / "area.geojson")
    coverage = planned(params, camera, seen_map(terrain=terrain), {"a": SQUARE}, area).coverage
    assert coverage.not_judged_m2 == pytest.approx(50.0, abs=0.1)
    assert "Not judged: 50 of 100 square metres" in coverage.sentences[0]
    assert not coverage.is_complete


def test_an_area_smaller_than_a_cell_is_the_cell(tmp_path):
    area = geojson(tmp_path / "area.geojson", 0.01 * SQUARE + 1.1)
    assert searched_cells(area, TERRAIN, {}).sum() == 1
