"""What a result costs the reducer here: real results through the wire form, the watermark and the map."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pipeline.config.fusion import Fusion
from pipeline.fusion.fuser import Fuser
from pipeline.fusion.sequencer import Sequencer
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, Detections, pack, unpack
from pipeline.mission.stages.reducer import ReducerStage

_SIDE_M, _CELL_M, _STREAMS = 300.0, 0.5, 8
_CAMERA = Camera(1024, 576, 900.0, 900.0, 512.0, 288.0)
_START_NS = 1_777_629_600_000_000_000


def result_cost_s(fusion: Fusion, results: int, clock: Callable[[], float]) -> float:
    """Seconds of the clock for one result, of so many: eight drones at 10 Hz, 15 to 40 m above rolling ground, a box in
    every tenth picture. A first quarter is not counted: it compiles.
    """
    x = np.arange(int(_SIDE_M / _CELL_M)) * _CELL_M
    heights = (3.0 * np.sin(x[:, None] / 20.0) * np.cos(x / 30.0)).astype(np.float32)
    terrain = Terrain(LocalFrame(48.0, 15.0), 0.0, 0.0, _CELL_M, heights)
    streams = [f"v{k}" for k in range(_STREAMS)]
    substreams = [(stream, "d") for stream in streams]
    fuser = Fuser(terrain, fusion, dict.fromkeys(streams, _CAMERA), {"d": 0.9})
    stage = ReducerStage(fuser, Sequencer(substreams, round(fusion.lateness * 1e9)), substreams)
    packed = [pack(_result(terrain, k)) for k in range(results)]
    first, begun = results // 4, clock()
    for k, data in enumerate(packed):
        if k == first:
            begun = clock()
        stage.push(unpack(data))
    stage.finish()
    return (clock() - begun) / (results - first)


def _result(terrain: Terrain, k: int) -> Detections:
    rng = np.random.default_rng(k)
    stream, index = k % _STREAMS, k // _STREAMS
    yaw, up_m = stream * 0.7, 15.0 + 3.0 * stream
    east = 60.0 + (20.0 * stream + index * 0.5) % (_SIDE_M - 120.0)
    north = 60.0 + (35.0 * stream + index * 0.2) % (_SIDE_M - 120.0)
    pose = CameraPose(
        np.array([east, north, terrain.height(east, north) + up_m]), enu_from_camera(yaw, -math.pi / 4.0, 0.0)
    )
    boxes = np.array([[500.0, 262.0, 520.0, 300.0]])[: int(rng.random() < 0.1)]
    time_ns = _START_NS + index * 100_000_000 + stream
    scores, classes = np.full(len(boxes), 0.9), np.zeros(len(boxes), dtype=np.int64)
    return Detections(f"v{stream}", "d", index, time_ns, pose, boxes, scores, classes)
