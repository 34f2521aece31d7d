"""A mission that ``searchlight simulate`` wrote, as a data set: its videos, its truth, its telemetry."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from pipeline.config.camera import load_camera
from pipeline.config.mission import Mission, Stream, load_mission
from pipeline.errors import InputError
from pipeline.evaluation.datasets.coco import CocoOptions, read_coco
from pipeline.evaluation.datasets.dataset import DataSet, Picture, joined
from pipeline.evaluation.datasets.fault_log import FaultLog
from pipeline.geo.terrain import Terrain, frame_of, load_terrain
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.trajectory_of import Ground, trajectory_of
from pipeline.sensor.expected_size import expected_person_px

_TERRAIN_CELL_M = 1.0


def read_mission(path: Path, options: CocoOptions, faults: FaultLog) -> DataSet:
    """The pictures of all streams that have truth/boxes-STREAM.json. Raises InputError if none has."""
    mission = load_mission(path)
    frame = frame_of(mission.terrain.file)
    terrain = load_terrain(mission.terrain.file, _TERRAIN_CELL_M, frame)
    sets = []
    for stream in mission.streams:
        boxes = path.parent / "truth" / f"boxes-{stream.id}.json"
        if boxes.is_file():
            own = replace(options, root=stream.video.parent)
            sets.append(_with_context(read_coco(boxes, own, faults), mission, stream, terrain))
    if not sets:
        raise InputError(
            path.parent / "truth", "no boxes-STREAM.json", "the truth that searchlight simulate writes"
        )
    return joined(sets)


def _with_context(dataset: DataSet, mission: Mission, stream: Stream, terrain: Terrain) -> DataSet:
    """With the expected size of a person in every picture, from the telemetry and the ground below."""
    track = read_telemetry(stream.telemetry)
    ground = Ground(mission.terrain.height_datum, terrain.height)
    trajectory = trajectory_of(track, stream.telemetry, terrain.frame, ground)
    focal_px = load_camera(stream.camera).fy
    rate = dataset.sequences[0].frame_rate or 1.0

    def seen(picture: Picture) -> Picture:
        pose = trajectory.pose(picture.frame / rate)
        if pose is None:
            return picture
        east, north, up = (float(x) for x in pose.position_enu)
        height_m = up - terrain.height(east, north)
        if math.isnan(height_m):
            return picture
        pitch_rad = math.asin(max(-1.0, min(1.0, float(pose.enu_from_camera[2, 2]))))
        return replace(picture, expected_px=expected_person_px(height_m, pitch_rad, focal_px))

    return replace(dataset, pictures=tuple(seen(p) for p in dataset.pictures))
