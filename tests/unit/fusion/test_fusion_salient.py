import dataclasses
import math

import numpy as np
import pytest

from pipeline.fusion.fuser import Fuser
from pipeline.fusion.localization import locate, mean_intersection
from pipeline.fusion.look import Look
from pipeline.fusion.salient import salient_locations
from pipeline.fusion.voxel_map import VoxelMap, log_odds
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, Detections

STANDING, LYING = (0.5, 0.4, 1.75), (0.5, 1.75, 0.25)


def _look(east, north, *, terrain, time_ns=0, p=0.8, stream="a"):
    """A look from 15 m above and 15 m south at a point on the ground."""
    camera = np.array([east, north - 15.0, 15.0])
    point = np.array([east, north, 0.0])
    row, column = (int(k) for k in terrain.cells(point[None])[0])
    ray = (point - camera) / np.linalg.norm(point - camera)
    attitude = enu_from_camera(0.0, math.radians(-45.0), 0.0)
    return Look(time_ns, stream, "d", 0.9, p, row, column, point, camera, ray, attitude, 1.0 / 900.0)


def _raised(terrain, looks):
    voxel_map = VoxelMap(terrain, 0.1192, 0.971)
    rows, columns = (
        np.array([getattr(k, name) for k in looks], dtype=np.int64) for name in ("row", "column")
    )
    voxel_map.update(rows, columns, log_odds(np.array([k.p for k in looks])))
    return voxel_map


def test_one_look_gives_its_own_place_not_the_cells_centre(plane, params):
    looks = [_look(0.05, 0.4, terrain=plane)]
    (found,) = salient_locations(_raised(plane, looks), looks, params)
    np.testing.assert_allclose(found.position_enu, [0.05, 0.4, 0.0], atol=1e-6)
    assert found.probability == pytest.approx(0.8, abs=1e-6)
    assert (found.id, found.class_name, found.cells, found.looks) == (1, "person", 1, 1)
    assert (found.setups, found.people, found.expected_people) == (("d",), 1, pytest.approx(0.8, abs=1e-6))


def test_latitude_and_longitude_are_those_of_the_position(plane, params):
    looks = [_look(10.0, -5.0, terrain=plane)]
    (found,) = salient_locations(_raised(plane, looks), looks, params)
    east, north = plane.frame.enu_from_wgs84(np.array(found.latitude_deg), np.array(found.longitude_deg))
    np.testing.assert_allclose([east, north], found.position_enu[:2], atol=1e-6)


def test_cells_within_the_cluster_distance_are_one_place_and_others_are_not(plane, params):
    norths = (0.25, 1.75, 3.25, 5.25)  # steps of 1.5, 1.5 and 2 m
    looks = [_look(0.25, north, terrain=plane, time_ns=i) for i, north in enumerate(norths)]
    first, second = salient_locations(_raised(plane, looks), looks, params)
    assert (first.cells, len(first.sightings), first.looks) == (3, 3, 1)
    assert (first.first_seen_ns, first.last_seen_ns) == (0, 2)
    assert second.cells == 1
    assert first.position_enu[1] == pytest.approx(1.75, abs=1e-3)
    assert first.spread_m == pytest.approx(math.sqrt(1.5), abs=1e-3)


def test_places_are_numbered_by_first_sight(plane, params):
    looks = [_look(9.0, 9.0, terrain=plane, time_ns=1), _look(-9.0, 0.0, terrain=plane, time_ns=2)]
    found = salient_locations(_raised(plane, looks), looks, params)
    assert [(f.id, f.position_enu[0] > 0.0) for f in found] == [(1, True), (2, False)]


def test_a_place_below_the_threshold_is_none(plane, params):
    looks = [_look(0.0, 0.0, terrain=plane, p=0.69)]
    assert salient_locations(_raised(plane, looks), looks, params) == ()


def test_the_probability_is_the_mean_of_the_cells(plane, params):
    looks = [_look(0.25, 0.25, terrain=plane, p=0.8), _look(0.75, 0.25, terrain=plane, p=0.9, stream="b")]
    (found,) = salient_locations(_raised(plane, looks), looks, params)
    assert found.probability == pytest.approx(0.85, abs=1e-6)
    assert found.streams == ("a", "b")


def test_the_average_is_weighted_by_the_updates(plane):
    looks = [_look(0.0, 0.0, terrain=plane, p=0.9), _look(1.0, 0.0, terrain=plane, p=0.75)]
    assert mean_intersection(looks)[0] == pytest.approx(1.0 / 3.0)  # log 9 against log 3


def test_without_parallax_the_place_is_the_papers_average(plane):
    looks = [_look(0.3, 0.2, terrain=plane)] * 5
    np.testing.assert_allclose(locate(looks), [0.3, 0.2], atol=1e-9)


@pytest.mark.parametrize("apart_m", [0.2, 1.0, -3.0])
@pytest.mark.parametrize("height_m", [10.0, 80.0])
def test_rays_and_ground_points_that_disagree_are_weighed_by_how_sure_they_are(plane, apart_m, height_m):
    """Straight down there is a closed form: rays are sure to 0.05 m and ground points to 0.5 m, a hundred to one."""
    look = dataclasses.replace(
        _look(0.0, 0.0, terrain=plane),
        camera_enu=np.array([0.0, 2.0, height_m]),
        center_ray_enu=np.array([0.0, 0.0, -1.0]),
        intersection_enu=np.array([apart_m, 2.0, 0.0]),
    )
    np.testing.assert_allclose(locate([look, look]), [apart_m / 101.0, 2.0], rtol=1e-6)


def _boxes(size, heading_rad, pose, camera):
    """Box of an ellipsoid of a body on the ground at (0, 0)."""
    angle, height = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 60), np.linspace(-1.0, 1.0, 31))
    ring = np.sqrt(1.0 - height**2)
    points = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=-1).reshape(-1, 3)
    points = points * np.array(size) / 2.0 + np.array([0.0, 0.0, size[2] / 2.0])
    s, c = math.sin(heading_rad), math.cos(heading_rad)
    u, v = camera.project_enu(points @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), pose).T
    return np.array([[u.min(), v.min(), u.max(), v.max()]])


def _fly_over(fuser, camera, size, heading_rad):
    """One pass to the north, 15 m up, 45 degrees down."""
    for i, south in enumerate(np.arange(28.0, 8.0, -0.5)):
        pose = CameraPose(np.array([1.0, -south, 15.0]), enu_from_camera(0.0, math.radians(-45.0), 0.0))
        box = _boxes(size, heading_rad, pose, camera)
        fuser.apply(Detections("a", "d", i, i, pose, box, np.array([0.9]), np.zeros(1, dtype=np.int64)))


@pytest.mark.parametrize("size", [STANDING, LYING], ids=["standing", "lying along the view"])
@pytest.mark.parametrize("heading_deg", [0.0, 30.0])
def test_one_pass_places_a_body_within_a_quarter_of_a_metre(plane, params, camera, size, heading_deg):
    fuser = Fuser(plane, params, {"a": camera}, {"d": 1.0})
    _fly_over(fuser, camera, size, math.radians(heading_deg))
    (found,) = salient_locations(fuser.map, fuser.looks, params)
    assert math.hypot(*found.position_enu[:2]) < 0.25
    assert found.probability > 0.8


def test_parallax_places_a_lying_body_better_than_the_papers_average(plane, params, camera):
    fuser = Fuser(plane, params, {"a": camera}, {"d": 1.0})
    _fly_over(fuser, camera, LYING, 0.0)
    assert math.hypot(*mean_intersection(fuser.looks)[:2]) > 0.5
    assert math.hypot(*locate(fuser.looks)) < 0.25


CORNERS = [(2.0, 2.0), (2.0, 3.0), (1.0, 1.0), (0.5, 0.5), (4.0, 0.5), (3.0, 1.0), (0.25, 10.0)]


@pytest.mark.parametrize(("cell_m", "cluster_m"), CORNERS)
@pytest.mark.parametrize("share", [(0.5, 0.5), (0.02, 0.03), (0.97, 0.01), (0.0, 0.99)])
def test_no_cell_above_the_threshold_is_left_out(params, cell_m, cluster_m, share):
    terrain = Terrain(LocalFrame(47.0, 8.0), -40.0, -40.0, cell_m, np.zeros((40, 40), dtype=np.float32))
    point = -40.0 + cell_m * (7.0 + np.array(share))
    looks = [_look(*point, terrain=terrain)]
    voxel_map = _raised(terrain, looks)
    (found,) = salient_locations(voxel_map, looks, params.model_copy(update={"cluster_distance": cluster_m}))
    assert len(found.sightings) == 1
    np.testing.assert_allclose(found.position_enu[:2], point, atol=1e-6)


@pytest.mark.parametrize("direction_deg", [0.0, 77.0, 200.0, 301.0])
@pytest.mark.parametrize(("share", "sightings"), [(0.47, 2), (0.53, 1), (0.9, 1), (1.8, 1)])
def test_a_sighting_belongs_to_a_place_within_half_the_cluster_distance(
    plane, params, share, sightings, direction_deg
):
    seen = _look(0.25, 0.25, terrain=plane)
    away_m, direction = share * params.cluster_distance, math.radians(direction_deg)
    middle = plane.centers(np.array([seen.row]), np.array([seen.column]))[0]
    east, north = middle[:2] + away_m * np.array([math.cos(direction), math.sin(direction)])
    other = _look(east, north, terrain=plane, time_ns=1)
    assert (other.row, other.column) != (seen.row, seen.column)
    (found,) = salient_locations(_raised(plane, [seen]), [seen, other], params)
    assert len(found.sightings) == sightings


def test_a_sighting_on_a_wall_belongs_to_its_cell(params):
    heights = np.zeros((160, 160), dtype=np.float32)
    heights[:, 80:] = 9.0  # a house
    terrain = Terrain(LocalFrame(47.0, 8.0), -40.0, -40.0, 0.5, heights)
    look = _look(0.02, 0.1, terrain=terrain)
    look.intersection_enu[2] = 4.0  # the ray meets the wall, 5 m below the middle of the roof's cell
    (found,) = salient_locations(_raised(terrain, [look]), [look], params)
    assert len(found.sightings) == 1


def test_cells_that_touch_are_one_place_whatever_the_cluster_distance(plane, params):
    looks = [_look(0.3, 0.3, terrain=plane), _look(0.8, 0.8, terrain=plane), _look(2.3, 0.3, terrain=plane)]
    near = params.model_copy(update={"cluster_distance": 0.1})
    first, second = salient_locations(_raised(plane, looks), looks, near)
    assert sorted((first.cells, second.cells)) == [1, 2]


def test_cells_that_no_sighting_is_near_are_listed_where_they_are(plane, params):
    looks = [_look(9.0, 9.0, terrain=plane)]
    voxel_map = _raised(plane, looks)
    rows, columns = plane.cells(np.array([[-5.1, 3.0], [-4.6, 3.0]])).T
    voxel_map.update(rows, columns, np.full(2, 2.0))
    voxel_map.tiles.cells["last_seen_ns"][voxel_map.tiles.flat(rows, columns)] = 7, 5
    lonely, seen = sorted(salient_locations(voxel_map, looks, params), key=lambda place: place.looks)
    assert (lonely.looks, lonely.sightings, lonely.streams, seen.looks) == (0, (), (), 1)
    np.testing.assert_allclose(lonely.position_enu[:2], [-5.0, 3.25], atol=1e-9)
    assert (lonely.first_seen_ns, lonely.last_seen_ns) == (7, 7)
    assert lonely.error.contains(np.array([0.45, 0.2]))
    assert lonely.probability == pytest.approx(1.0 / (1.0 + math.exp(-2.0)))


def test_what_supports_a_place_is_told(plane, params):
    at = [("a", "m:nano", 0), ("a", "m:nano", 10**8), ("a", "m:small", 10**8), ("b", "n:nano", 10**8)]
    at += [("a", "m:nano", 5 * 10**9)]
    looks = [
        dataclasses.replace(_look(0.0, 0.0, terrain=plane, stream=s, time_ns=t, p=0.7), detector=d)
        for s, d, t in at
    ]
    (found,) = salient_locations(_raised(plane, looks), looks, params)
    assert (len(found.sightings), found.looks) == (5, 3)  # a, b at the same time, and a again
    assert (found.streams, found.setups) == (("a", "b"), ("m:nano", "m:small", "n:nano"))
    assert found.last_seen_ns == 5 * 10**9
