"""A mission that ``searchlight simulate`` wrote, as a data set: its videos, its truth, its telemetry."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from pipeline.config.mission import Stream, load_mission
from pipeline.errors import InputError
from pipeline.evaluation.datasets.coco import CocoOptions, read_coco
from pipeline.evaluation.datasets.dataset import DataSet, Picture, joined
from pipeline.evaluation.datasets.fault_log import FaultLog
from pipeline.ingest.cameras.calibration_file import read_calibration
from pipeline.ingest.ground import GroundModel, frame_over, load_ground, window_about
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.trajectory_of import trajectory_of
from pipeline.sensor.expected_size import expected_person_px

_TERRAIN_CELL_M = 1.0
#: about the flights, metres
_REACH_M = 500.0


def read_mission(path: Path, options: CocoOptions, faults: FaultLog) -> DataSet:
    """The pictures of all streams that have truth/boxes-STREAM.json. Raises InputError if none has."""
    mission = load_mission(path)
    tracks = [read_telemetry(stream.telemetry) for stream in mission.streams]
    frame = frame_over(mission.terrain, tracks)
    ground = load_ground(
        mission.terrain, _TERRAIN_CELL_M, frame, window_about(tracks, frame, _REACH_M), tracks
    )
    sets = []
    for stream in mission.streams:
        boxes = path.parent / "truth" / f"boxes-{stream.id}.json"
        if boxes.is_file():
            own = replace(options, root=stream.pictures.parent)
            sets.append(_with_context(read_coco(boxes, own, faults), stream, ground))
    if not sets:
        raise InputError(
            path.parent / "truth", "no boxes-STREAM.json", "the truth that searchlight simulate writes"
        )
    return joined(sets)


def _with_context(dataset: DataSet, stream: Stream, model: GroundModel) -> DataSet:
    """With the expected size of a person in every picture, from the telemetry and the ground below."""
    track = read_telemetry(stream.telemetry)
    terrain = model.terrain
    trajectory = trajectory_of(track, stream.telemetry, terrain.frame, model.ground)
    if stream.camera.file is None:
        raise InputError(
            f"stream {stream.id} camera", "no calibration file", "the one that searchlight simulate writes"
        )
    focal_px = read_calibration(stream.camera.file).camera.fy
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
        return replace(
            picture, expected_px=expected_person_px(height_m, pitch_rad, focal_px * pose.focal_scale)
        )

    return replace(dataset, pictures=tuple(seen(p) for p in dataset.pictures))
