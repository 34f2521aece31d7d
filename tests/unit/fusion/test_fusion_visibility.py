"""The horizon sweep against nine rays in every pixel, each met exactly with the surface."""

import math

import numpy as np
import pytest
from benchmarks.ray_casting import cells_hit

from pipeline.fusion.visibility import visible_cells
from pipeline.fusion.visibility_kernels import look_up, slopes
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose

SMALL = Camera(96, 54, 84.0, 84.0, 48.0, 27.0)
LARGER = Camera(192, 108, 168.0, 168.0, 96.0, 54.0)
BENT = Camera(96, 54, 84.0, 84.0, 47.0, 28.0, np.array([-0.2, 0.05, 0.002, -0.001, 0.0]))
LARGER_BENT = Camera(192, 108, 168.0, 168.0, 94.0, 56.0, BENT.distortion)
NO_BOXES = np.zeros((0, 4))


def _bumpy(seed: int, cell_m: float = 0.5) -> Terrain:
    """60 m x 60 m of hills with boulders, walls and houses."""
    rng = np.random.default_rng(seed)
    n = int(60.0 / cell_m)
    x = (np.arange(n) + 0.5) * cell_m - 30.0
    east, north = np.meshgrid(x, x)
    heights = 1.5 * np.sin(0.2 * east + rng.uniform(0.0, 6.0)) * np.cos(0.15 * north + rng.uniform(0.0, 6.0))
    for _ in range(12):
        e, n_, size = rng.uniform(-25.0, 25.0), rng.uniform(-25.0, 25.0), rng.uniform(1.0, 2.5)
        heights += 2.0 * np.maximum(0.0, 1.0 - np.hypot(east - e, north - n_) / size)
    for _ in range(5):
        e, n_, a, b = rng.uniform(-25.0, 25.0, 2).tolist() + rng.uniform(0.5, 4.0, 2).tolist()
        heights += rng.uniform(2.0, 4.0) * ((np.abs(east - e) < a) & (np.abs(north - n_) < b))
    return Terrain(LocalFrame(47.0, 8.0), -30.0, -30.0, cell_m, heights.astype(np.float32))


def _plane(cell_m: float = 0.5) -> Terrain:
    n = int(60.0 / cell_m)
    return Terrain(LocalFrame(47.0, 8.0), -30.0, -30.0, cell_m, np.zeros((n, n), dtype=np.float32))


def _pose(east: float, north: float, up: float, yaw_deg: float, pitch_deg: float, roll_deg: float = 0.0):
    angles = (math.radians(a) for a in (yaw_deg, pitch_deg, roll_deg))
    return CameraPose(np.array([east, north, up]), enu_from_camera(*angles))


def _seen(terrain, camera, pose, max_distance_m=80.0, boxes=NO_BOXES):
    rows, columns, _ = visible_cells(terrain, camera, pose, max_distance_m, boxes)
    seen = np.zeros(terrain.shape, dtype=bool)
    seen[rows, columns] = True
    return seen


CASES = {
    "ahead": (1, LARGER, _pose(-5.0, -12.0, 10.0, 20.0, -45.0)),
    "rolled": (2, LARGER, _pose(3.0, 12.0, 10.0, 200.0, -45.0, 10.0)),
    "straight down": (3, LARGER, _pose(2.0, 1.0, 12.0, 70.0, -90.0)),
    "pole near the edge": (4, LARGER, _pose(4.0, -2.0, 12.0, 300.0, -78.0)),
    "from outside": (5, LARGER, _pose(-32.0, 2.0, 10.0, 90.0, -45.0)),
    "bent lens": (6, LARGER_BENT, _pose(0.0, -12.0, 10.0, 355.0, -45.0, -5.0)),
}


def _precision_and_recall(seed, camera, pose):
    terrain = _bumpy(seed)
    ours, rays = _seen(terrain, camera, pose), cells_hit(terrain, camera, pose, 3, 80.0)
    assert rays.sum() > 400
    return (ours & rays).sum() / ours.sum(), (ours & rays).sum() / rays.sum()


@pytest.mark.parametrize("case", CASES)
def test_every_pose_sees_what_rays_see(case):
    precision, recall = _precision_and_recall(*CASES[case])
    assert precision >= 0.98
    assert recall >= 0.96


def test_all_poses_together_see_what_rays_see():
    precision, recall = np.mean([_precision_and_recall(*case) for case in CASES.values()], axis=0)
    assert precision >= 0.99
    assert recall >= 0.985


def test_the_rays_of_the_reference_end_where_the_terrain_says():
    terrain, pose = _bumpy(1), _pose(-5.0, -12.0, 10.0, 20.0, -45.0)
    pixels = np.stack(np.meshgrid(np.arange(96) + 0.5, np.arange(54) + 0.5), axis=-1).reshape(-1, 2)
    hits = [terrain.intersect(pose.position_enu, ray, 80.0) for ray in SMALL.rays_enu(pixels, pose)]
    rows, columns = terrain.cells(np.array([hit for hit in hits if hit is not None])).T
    marched, exact = np.zeros(terrain.shape, dtype=bool), cells_hit(terrain, SMALL, pose, 1, 80.0)
    marched[rows, columns] = True
    assert (marched & exact).sum() >= 0.99 * max(marched.sum(), exact.sum())


def test_on_a_plane_the_footprint_is_that_of_the_pictures_corners():
    terrain, pose = _plane(0.25), _pose(0.0, 0.0, 10.0, 0.0, -90.0)
    seen = _seen(terrain, SMALL, pose)
    area_m2 = seen.sum() * 0.25**2
    width_m, height_m = 96.0 / 84.0 * 10.0, 54.0 / 84.0 * 10.0
    assert width_m * height_m < area_m2 < (width_m + 0.5) * (height_m + 0.5)


def test_a_wall_hides_what_is_behind_it():
    terrain = _plane()
    terrain.heights_m[80, :] = 6.0  # 10 m north
    rows, _, _ = visible_cells(terrain, SMALL, _pose(0.0, 0.0, 8.0, 0.0, -20.0), 80.0, NO_BOXES)
    # over the crest at 10.25 m, 2 m below the camera, the ground comes into sight at 41 m: outside
    assert rows.max() <= 80
    assert (rows == 80).any()


def test_each_cell_comes_once_and_in_the_same_order():
    terrain, pose = _bumpy(1), _pose(-5.0, -15.0, 13.0, 20.0, -45.0)
    first = visible_cells(terrain, SMALL, pose, 80.0, NO_BOXES)
    again = visible_cells(terrain, SMALL, pose, 80.0, NO_BOXES)
    assert len(set(zip(first[0], first[1], strict=True))) == len(first[0])
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)


def test_distances_are_those_of_the_centres_and_limited():
    terrain, pose = _bumpy(1), _pose(-5.0, -15.0, 13.0, 20.0, -45.0)
    rows, columns, distances = visible_cells(terrain, SMALL, pose, 20.0, NO_BOXES)
    centers = terrain.centers(rows, columns)
    np.testing.assert_allclose(distances, np.linalg.norm(centers - pose.position_enu, axis=1), rtol=1e-9)
    assert distances.max() <= 20.0


@pytest.mark.parametrize("camera", [SMALL, BENT], ids=["pinhole", "bent lens"])
def test_exactly_the_cells_whose_centre_is_in_a_box_are_left_out(camera):
    terrain, pose = _bumpy(2), _pose(3.0, 14.0, 12.0, 200.0, -40.0)
    boxes = np.array([[30.0, 20.0, 40.0, 35.0], [60.0, 5.0, 61.0, 50.0]])
    rows, columns, _ = visible_cells(terrain, camera, pose, 80.0, NO_BOXES)
    u, v = camera.project_enu(terrain.centers(rows, columns), pose).T
    inside = np.zeros(len(rows), dtype=bool)
    for x0, y0, x1, y1 in boxes:
        inside |= (x0 <= u) & (u <= x1) & (y0 <= v) & (v <= y1)
    kept_rows, kept_columns, _ = visible_cells(terrain, camera, pose, 80.0, boxes)
    assert inside.any()
    np.testing.assert_array_equal(kept_rows, rows[~inside])
    np.testing.assert_array_equal(kept_columns, columns[~inside])


@pytest.mark.parametrize("camera", [SMALL, BENT], ids=["pinhole", "bent lens"])
def test_exactly_the_cells_where_an_object_would_be_whole_in_the_picture_are_kept(camera):
    terrain, pose = _bumpy(2), _pose(3.0, 14.0, 12.0, 200.0, -40.0, 8.0)
    rows, columns, _ = visible_cells(terrain, camera, pose, 80.0, NO_BOXES)
    foot = terrain.centers(rows, columns)
    depth = (foot - pose.position_enu) @ pose.enu_from_camera[:, 2]
    size, reach = np.array([camera.width, camera.height]), 0.85 * camera.fx / depth[:, None]
    low, high = camera.project_enu(foot, pose), camera.project_enu(foot + np.array([0.0, 0.0, 1.7]), pose)
    whole = ((low >= reach) & (low <= size - reach) & (high >= 0.0) & (high <= size)).all(axis=1)
    kept_rows, kept_columns, _ = visible_cells(terrain, camera, pose, 80.0, NO_BOXES, 1.7)
    assert 0.3 < whole.mean() < 0.9
    np.testing.assert_array_equal(kept_rows, rows[whole])
    np.testing.assert_array_equal(kept_columns, columns[whole])


def test_cells_of_unknown_height_are_never_seen():
    terrain = _plane()
    terrain.heights_m[60:70, 50:70] = np.nan
    seen = _seen(terrain, SMALL, _pose(0.0, -10.0, 10.0, 0.0, -45.0))
    assert seen.any()
    assert not seen[60:70, 50:70].any()


@pytest.mark.parametrize(
    "pose", [_pose(0.0, 0.0, 10.0, 0.0, 45.0), _pose(900.0, 0.0, 10.0, 0.0, -45.0)], ids=["sky", "far away"]
)
def test_a_camera_that_sees_no_ground_sees_no_cell(pose):
    assert not _seen(_plane(), SMALL, pose).any()


def test_a_camera_above_the_horizon_sees_to_the_edge():
    assert _seen(_plane(), SMALL, _pose(0.0, -29.0, 10.0, 0.0, -10.0)).T[60, -1]


def test_slopes_of_a_level_camera_are_those_of_its_picture():
    corners = SMALL.rays(np.array([[0.0, 0.0], [96.0, 0.0], [96.0, 54.0], [0.0, 54.0]]))
    outline = corners @ enu_from_camera(0.0, 0.0, 0.0).T
    assert slopes(outline, 0.0, 1.0) == pytest.approx((-27.0 / 84.0, 27.0 / 84.0))
    assert slopes(outline, 0.0, -1.0) == (math.inf, -math.inf)


def test_the_sweeps_surface_is_the_terrains_on_lines_of_centres():
    terrain, slope, cell = _bumpy(7), np.empty(32), np.empty(32, dtype=np.int32)
    for x in np.random.default_rng(0).uniform(-0.5, 119.5, 20):
        look_up(terrain.heights_m, 50.0, (33, 1, 32, 4.0, x, 0.4, 1.0), 3, 25, (0, 120, 0, 1), slope, cell)
        for k in range(3, 25):
            ours = 50.0 + slope[k - 3] * (4.0 + k)
            east_m, north_m = -30.0 + (x + 0.4 * k + 0.5) * 0.5, -30.0 + (33 + k + 0.5) * 0.5
            if east_m < 30.0:
                assert tuple(divmod(int(cell[k - 3]), 120)) == terrain.cell(east_m, north_m)
                assert ours == pytest.approx(terrain.height(east_m, north_m), abs=1e-4)
