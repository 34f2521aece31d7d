"""Read and check everything a mission names, before anything is started."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.allocation.build import build_problem
from pipeline.allocation.problem import Problem
from pipeline.config.camera import load_camera
from pipeline.config.inventory import Inventory, load_inventory
from pipeline.config.mission import Mission, Stream, load_mission
from pipeline.config.pool import Pool, PoolDetector, load_pool
from pipeline.errors import InputError
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.search_area import load_search_area
from pipeline.geo.surfaces import load_mesh
from pipeline.geo.terrain import Terrain, frame_of, load_terrain
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.trajectory import Trajectory, require_complete
from pipeline.ingest.video.file import check_video, sampled_indices
from pipeline.link.codec import require_codec
from pipeline.mission.checks import models_load, sites_exist, telemetry_covers, terrain_covers
from pipeline.mission.stages.source import StreamInput
from pipeline.sensor.expected_size import expected_person_px


@dataclass(frozen=True, eq=False)
class PreparedMission:
    """A mission whose every file was read and found usable."""

    path: Path
    mission: Mission
    inventory: Inventory
    pool: Pool
    terrain: Terrain
    cameras: dict[str, Camera]
    streams: tuple[StreamInput, ...]
    problem: Problem

    @property
    def frame(self) -> LocalFrame:
        """The map frame."""
        return self.terrain.frame

    @property
    def relative_accuracy(self) -> dict[str, float]:
        """The paper's p_det_rel of every pool detector: its best accuracy over the best of the pool."""
        best = {d.id: max(a.accuracy for a in d.accuracy) for d in self.pool.detectors}
        return {name: accuracy / max(best.values()) for name, accuracy in best.items()}

    def runnable(self, pool_detector: str) -> PoolDetector:
        """A pool detector that has a model."""
        detector = next(d for d in self.pool.detectors if d.id == pool_detector)
        detector.require_model(f"{self.mission.pool} {pool_detector}.model")
        return detector


def prepare(path: Path, thorough: bool = False) -> PreparedMission:
    """Read and check a mission; if thorough, every picture of every video is decoded.

    Raises InputError for the first thing that cannot be used.
    """
    mission = load_mission(path)
    inventory, pool = load_inventory(mission.inventory), load_pool(mission.pool)
    sites_exist(path, mission, inventory)
    for codec in (mission.processing.codec, *mission.processing.codecs):
        require_codec(codec)
    frame = _frame(mission)
    cameras = {s.id: load_camera(s.camera) for s in mission.streams}
    streams = tuple(_stream(path, mission, s, frame, cameras[s.id], thorough) for s in mission.streams)
    terrain = terrain_at(mission, frame, mission.fusion.cell_size)
    for stream in streams:
        terrain_covers(mission, terrain, stream)
    if mission.search_area is not None:
        load_search_area(mission.search_area, frame)
    models_load(pool)
    own_site = {s.id: s.site for s in mission.streams}
    person_px = {}
    if mission.processing.expected_size:
        person_px = {s.stream: _person_px(terrain, cameras[s.stream], s) for s in streams}
    problem = build_problem(own_site, mission.processing, inventory, pool, where=path, person_px=person_px)
    return PreparedMission(path, mission, inventory, pool, terrain, cameras, streams, problem)


def terrain_at(mission: Mission, frame: LocalFrame, cell_m: float) -> Terrain:
    """The mission's terrain in cells of a size."""
    load = load_terrain if mission.terrain.origin is None else load_mesh
    return load(mission.terrain.file, cell_m, frame)


def _frame(mission: Mission) -> LocalFrame:
    """The map frame: its origin is the mesh's, or the middle of the surface model."""
    origin = mission.terrain.origin
    if origin is None:
        return frame_of(mission.terrain.file)
    return LocalFrame(math.degrees(origin.latitude), math.degrees(origin.longitude))


def _stream(
    path: Path, mission: Mission, stream: Stream, frame: LocalFrame, camera: Camera, thorough: bool
) -> StreamInput:
    video = check_video(stream.video, thorough)
    track = read_telemetry(stream.telemetry)
    require_complete(track, stream.telemetry.file)
    if (video.width, video.height) != (camera.width, camera.height):
        raise InputError(
            f"{stream.camera} width, height",
            f"{camera.width} x {camera.height}",
            f"the size of {stream.video}, {video.width} x {video.height}",
        )
    telemetry_covers(stream, video, track)
    result = StreamInput(
        stream=stream.id,
        site=stream.site,
        video=video,
        trajectory=Trajectory(track, stream.telemetry, frame, mission.terrain.height_datum),
        processing_rate_hz=mission.processing.frame_rate,
        codec=mission.processing.codec,
    )
    sampled_indices(
        video.frames, video.frame_rate, mission.processing.frame_rate, where=f"{path} processing.frame_rate"
    )
    return result


def _person_px(terrain: Terrain, camera: Camera, stream: StreamInput) -> float:
    """The size of a person to be expected in the stream's pictures: the median over its seconds."""
    sizes = []
    for time_s in np.arange(0.0, stream.video.duration_s, 1.0):
        pose = stream.trajectory.pose(float(time_s))
        if pose is None:
            continue
        east, north, up = pose.position_enu
        pitch_rad = float(np.arcsin(pose.enu_from_camera[2, 2]))
        sizes.append(expected_person_px(up - terrain.height(east, north), pitch_rad, camera.fy))
    return float(np.median(sizes))
