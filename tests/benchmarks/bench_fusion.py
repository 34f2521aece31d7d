"""Milliseconds per frame of the fusion, beside OctoMap's and the floor, and what the sweep sees beside rays.

The scene of the project's measurements: 250 m x 250 m of hills, trees and houses; 1024x576, f = 900 px, 15-40
m up, 45 degrees down; two boxes per frame. One core. All of a cell size is measured in turns, so that a busy
machine slows all alike; of each pose the fastest of REPEATS counts
(OctoMap, which is slow, has OCTOMAP_REPEATS), of the poses the median.

Run: python tests/benchmarks/bench_fusion.py
OctoMap needs the extra [bench] (pyoctomap); without it its columns are left out.
"""

import math
import time
from importlib.util import find_spec

import numpy as np
from ray_casting import cells_hit

from pipeline.config.fusion import Fusion
from pipeline.fusion.fuser import Fuser
from pipeline.fusion.visibility import visible_cells
from pipeline.fusion.voxel_map import VoxelMap
from pipeline.fusion.voxel_map_kernels import add_clamped
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, Detections

SIDE_M = 250.0
CAMERA = Camera(1024, 576, 900.0, 900.0, 512.0, 288.0)
BOXES = np.array([[487.0, 218.0, 537.0, 288.0], [200.0, 300.0, 250.0, 380.0]])
NO_BOXES = np.zeros((0, 4))
POSES, REPEATS, OCTOMAP_REPEATS = 20, 30, 7
OCTOMAP_RAYS = (256, 144)


def hilly_terrain(cell_m: float) -> Terrain:
    """Hills, trees and houses."""
    rng = np.random.default_rng(1)
    x = (np.arange(int(SIDE_M / cell_m)) + 0.5) * cell_m
    east, north = np.meshgrid(x, x)
    heights = np.zeros_like(east)
    for _ in range(12):
        k = rng.normal(size=2) * 0.06
        heights += rng.uniform(0.3, 1.5) * np.sin(k[0] * east + k[1] * north + rng.uniform(0.0, 6.0))
    for _ in range(120):
        e, n, radius = rng.uniform(0.0, SIDE_M), rng.uniform(0.0, SIDE_M), rng.uniform(0.7, 3.0)
        share = np.hypot(east - e, north - n) / radius
        heights += rng.uniform(1.0, 7.0) * np.sqrt(np.maximum(1.0 - share**2, 0.0))
    for _ in range(8):
        e, n, a, b = *rng.uniform(0.0, SIDE_M, 2), *rng.uniform(3.0, 8.0, 2)
        heights += rng.uniform(3.0, 7.0) * ((np.abs(east - e) < a) & (np.abs(north - n) < b))
    return Terrain(LocalFrame(47.0, 8.0), 0.0, 0.0, cell_m, heights.astype(np.float32))


def fusion_params(cell_m: float) -> Fusion:
    low, high = {"meters": 0.5}, {"meters": 2.2}
    size = {"width_min": low, "width_max": high, "height_min": low, "height_max": high}
    return Fusion.model_validate(
        {
            "cell_size": {"meters": cell_m},
            "positive_max": 0.4,
            "negative_max": 0.1,
            "tukey_alpha": 0.5,
            "significant_point": "bottom_center",
            "object_size": size,
            "threshold": 0.7,
            "cluster_distance": {"meters": 1.5},
            "lateness": {"seconds": 2.0},
        }
    )


def _frames(terrain: Terrain, count: int) -> list[Detections]:
    rng = np.random.default_rng(5)
    frames = []
    for i in range(count):
        east, north = rng.uniform(40.0, 210.0, 2)
        up = terrain.height(east, north) + rng.uniform(15.0, 40.0)
        attitude = enu_from_camera(rng.uniform(0.0, 2.0 * math.pi), -math.pi / 4.0, 0.0)
        pose = CameraPose(np.array([east, north, up]), attitude)
        frames.append(Detections("a", "d", i, i, pose, BOXES, np.full(2, 0.8), np.zeros(2, dtype=np.int64)))
    return frames


class OctoMap:
    """The paper's framework with a ray for every fourth pixel: find the visible cells, then lower them."""

    def __init__(self, terrain: Terrain) -> None:
        from pyoctomap import OcTree

        self._terrain = terrain
        self._rows, self._columns = np.indices(terrain.shape).reshape(2, -1)
        self._tree = OcTree(terrain.cell_m)
        for point in terrain.centers(self._rows, self._columns):
            self._tree.updateNode(point, True)
        u, v = ((np.arange(n) + 0.5) * 4.0 for n in OCTOMAP_RAYS)
        self._pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)

    def cast(self, frame: Detections) -> None:
        """Cast the rays of a frame and lower each cell that one of them hits."""
        rays, origin, seen = CAMERA.rays_enu(self._pixels, frame.pose), frame.pose.position_enu, set()
        end = np.zeros(3)
        for ray in rays:
            if self._tree.castRay(origin, ray, end, ignoreUnknownCells=True, maxRange=300.0):
                seen.add(tuple(end.tolist()))
        for cell in seen:
            self._tree.updateNode(np.array(cell), -0.01)

    def update(self, points: list[np.ndarray]) -> None:
        """Lower the given cells."""
        for point in points:
            self._tree.updateNode(point, -0.01)


def _ms(function, *arguments) -> float:
    start = time.perf_counter()
    function(*arguments)
    return (time.perf_counter() - start) * 1e3


def speed(cell_m: float) -> str:
    """One line: milliseconds per frame of the fusion, the floor and OctoMap."""
    terrain = hilly_terrain(cell_m)
    frames = _frames(terrain, POSES)
    fuser = Fuser(terrain, fusion_params(cell_m), {"a": CAMERA}, {"d": 1.0})
    floor_map, ours, floor, given = VoxelMap(terrain, 0.1192, 0.971), [], [], []
    octomap = OctoMap(terrain) if find_spec("pyoctomap") else None
    seen = [visible_cells(terrain, CAMERA, f.pose, 300.0, BOXES)[:2] for f in frames]
    cells, limits = floor_map.tiles.cells, floor_map.limits
    lists = [floor_map.tiles.flat(rows.astype(np.int64), columns.astype(np.int64)) for rows, columns in seen]
    deltas = [np.full(len(rows), -0.01) for rows, _ in seen]
    points = [list(terrain.centers(*cells)) for cells in seen]
    for repeat in range(REPEATS + 1):  # the first round compiles
        ours.append([_ms(fuser.apply, frame) for frame in frames])
        floor.append([_ms(add_clamped, cells, *case, *limits) for case in zip(lists, deltas, strict=True)])
        if octomap and repeat <= OCTOMAP_REPEATS:
            given.append([_ms(octomap.update, case) for case in points])
    cast = [_ms(octomap.cast, frame) for frame in frames[:5]] if octomap else []
    times = [float(np.median(np.min(case[1:], axis=0))) for case in (ours, floor, given) if case]
    line = f"{cell_m:6.2f} {np.mean([len(rows) for rows, _ in seen]):12.0f} {times[0]:9.3f} {times[1]:9.4f}"
    line += f" {times[0] / times[1]:8.1f}"
    if octomap:
        ray_ms = float(np.median(cast))
        line += f" {times[2]:11.2f} {times[2] / times[0]:7.1f} {ray_ms:9.0f} {ray_ms / times[0]:7.0f}"
    return line


def accuracy(cell_m: float) -> str:
    """One line: what the sweep sees against 9 rays in every pixel."""
    terrain, shares = hilly_terrain(cell_m), []
    for frame in _frames(terrain, POSES):
        rows, columns, _ = visible_cells(terrain, CAMERA, frame.pose, 300.0, NO_BOXES)
        rays = cells_hit(terrain, CAMERA, frame.pose, 3, 300.0)
        both = rays[rows, columns].sum()
        shares.append((both / len(rows), both / rays.sum()))
    mean, worst = np.mean(shares, axis=0), np.min(shares, axis=0)
    return (
        f"at {cell_m} m against 9 rays per pixel, {POSES} poses: "
        f"precision {mean[0]:.4f} (worst {worst[0]:.4f}), recall {mean[1]:.4f} (worst {worst[1]:.4f})"
    )


def main() -> None:
    """Measure and print."""
    print("ms per frame: Fuser.apply; the floor, adding to a given list; OctoMap, list given, and cast")
    print("cell_m  cells/frame     apply     floor   /floor  updateNode  /apply   castRay  /apply")
    for cell_m in (1.0, 0.5, 0.25):
        print(speed(cell_m), flush=True)
    print(accuracy(0.5))


if __name__ == "__main__":
    main()
