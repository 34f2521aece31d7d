"""Milliseconds per frame of Fuser.apply, on the scene of the project's measurements.

250 m x 250 m of hills, trees and houses; 1024x576, f = 900 px, 15-40 m up, 45 degrees down;
two boxes per frame. Run: python tests/benchmarks/bench_fusion.py
"""

import math
import time

import numpy as np

from pipeline.config.mission import Fusion
from pipeline.fusion.fuser import Fuser
from pipeline.fusion.visibility import visible_cells
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, Detections

SIDE_M = 250.0
CAMERA = Camera(1024, 576, 900.0, 900.0, 512.0, 288.0)
BOXES = np.array([[487.0, 218.0, 537.0, 288.0], [200.0, 300.0, 250.0, 380.0]])
REPEATS = 7


def _terrain(cell_m: float) -> Terrain:
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


def _params(cell_m: float) -> Fusion:
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


def _fastest_ms(function, *arguments) -> float:
    took = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        function(*arguments)
        took.append(time.perf_counter() - start)
    return min(took) * 1e3


def main() -> None:
    print("cell_m  cells/frame  visible_ms  apply_ms   (median over 20 poses of the fastest of 7)")
    for cell_m in (1.0, 0.5, 0.25):
        terrain = _terrain(cell_m)
        fuser = Fuser(terrain, _params(cell_m), {"a": CAMERA}, {"d": 1.0})
        frames = _frames(terrain, 20)
        fuser.apply(frames[0])
        seen = [visible_cells(terrain, CAMERA, f.pose, 300.0, BOXES) for f in frames]
        visible_ms = [_fastest_ms(visible_cells, terrain, CAMERA, f.pose, 300.0, BOXES) for f in frames]
        apply_ms = [_fastest_ms(fuser.apply, f) for f in frames]
        cells = np.mean([len(rows) for rows, _, _ in seen])
        print(f"{cell_m:6.2f}  {cells:11.0f}  {np.median(visible_ms):10.2f}  {np.median(apply_ms):8.2f}")


if __name__ == "__main__":
    main()
