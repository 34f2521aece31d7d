"""Read and check everything a mission names, before anything is started."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.allocation.build import build_problem
from pipeline.allocation.decomposed import solve
from pipeline.allocation.explain import explain
from pipeline.allocation.plan import Plan
from pipeline.allocation.problem import Problem
from pipeline.config.camera import load_camera
from pipeline.config.inventory import Inventory, load_inventory, require_streams
from pipeline.config.mission import Mission, Stream, load_mission
from pipeline.config.pool import Pool, PoolDetector, load_pool
from pipeline.detection import open_pool_detector
from pipeline.errors import InputError, NoPlanError, NoPlanInTimeError
from pipeline.geo.camera import Camera
from pipeline.geo.expected_size import expected_person_px
from pipeline.geo.frame import LocalFrame
from pipeline.geo.search_area import load_search_area
from pipeline.geo.surfaces import load_mesh
from pipeline.geo.terrain import Terrain, frame_of, load_terrain
from pipeline.stages.source import StreamInput
from pipeline.telemetry.dji_srt import read_dji_srt
from pipeline.telemetry.track import Track, pose_at, require_complete
from pipeline.video.codec import require_codec
from pipeline.video.source import VideoInfo, check_video, sampled_indices


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
    _sites_exist(path, mission, inventory)
    for codec in (mission.processing.codec, *mission.processing.codecs):
        require_codec(codec)
    frame = _frame(mission)
    cameras = {s.id: load_camera(s.camera) for s in mission.streams}
    streams = tuple(_stream(path, mission, s, frame, cameras[s.id], thorough) for s in mission.streams)
    terrain = terrain_at(mission, frame, mission.fusion.cell_size)
    for stream in streams:
        _terrain_covers(mission, terrain, stream)
    if mission.search_area is not None:
        load_search_area(mission.search_area, frame)
    _models_load(pool)
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


def plan(prepared: PreparedMission) -> Plan:
    """The optimal plan. Raises NoPlanError if there is none, naming the limits that clash."""
    limit_s = prepared.mission.processing.time_limit
    result = solve(prepared.problem, time_limit_s=limit_s)
    if result.status == "infeasible":
        raise NoPlanError(
            f"{prepared.path}: no allocation satisfies the mission: {explain(prepared.problem).text}"
        )
    if result.status == "unknown":
        raise NoPlanInTimeError(
            f"{prepared.path} processing.time_limit: found no plan within {limit_s:g} s; expected more time"
        )
    for assignment in result.assignments:
        prepared.runnable(assignment.pool_detector)
    return result


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
    track = read_dji_srt(stream.telemetry.file)
    require_complete(track, stream.telemetry.file)
    if (video.width, video.height) != (camera.width, camera.height):
        raise InputError(
            f"{stream.camera} width, height",
            f"{camera.width} x {camera.height}",
            f"the size of {stream.video}, {video.width} x {video.height}",
        )
    _telemetry_covers(stream, video, track)
    result = StreamInput(
        stream=stream.id,
        site=stream.site,
        video=video,
        track=track,
        telemetry=stream.telemetry,
        frame=frame,
        terrain_datum=mission.terrain.height_datum,
        processing_rate_hz=mission.processing.frame_rate,
        codec=mission.processing.codec,
    )
    sampled_indices(
        video.frames, video.frame_rate, mission.processing.frame_rate, where=f"{path} processing.frame_rate"
    )
    return result


def _telemetry_covers(stream: Stream, video: VideoInfo, track: Track) -> None:
    first = track.times_s[0] + stream.telemetry.time_offset
    last = track.times_s[-1] + stream.telemetry.time_offset
    last_frame_s = (video.frames - 1) / video.frame_rate
    slack_s = 1.5 / video.frame_rate
    if first > slack_s or last < last_frame_s - slack_s:
        raise InputError(
            stream.telemetry.file,
            f"telemetry from {first:.2f} s to {last:.2f} s",
            f"telemetry for 0 s to {last_frame_s:.2f} s of {stream.video}, or another telemetry.time_offset",
        )


def _terrain_covers(mission: Mission, terrain: Terrain, stream: StreamInput) -> None:
    for time_s in np.arange(0.0, stream.video.duration_s - 1.0 / stream.video.frame_rate, 1.0):
        pose = pose_at(stream.track, float(time_s), stream.telemetry, stream.frame, stream.terrain_datum)
        east, north, up = pose.position_enu
        ground = terrain.height(east, north)
        where = f"{mission.terrain.file} under {stream.stream} at {time_s:.0f} s"
        if np.isnan(ground):
            raise InputError(
                where,
                f"no ground at east {east:.0f} m, north {north:.0f} m",
                "a terrain that covers the flight",
            )
        if up <= ground:
            raise InputError(
                where,
                f"the drone at {up:.1f} m, ground at {ground:.1f} m",
                "a drone above the ground: the same height datum?",
            )


def _person_px(terrain: Terrain, camera: Camera, stream: StreamInput) -> float:
    """The size of a person to be expected in the stream's pictures: the median over its seconds."""
    sizes = []
    for time_s in np.arange(0.0, stream.video.duration_s, 1.0):
        last_s = min(float(time_s), float(stream.track.times_s[-1]))
        pose = pose_at(stream.track, last_s, stream.telemetry, stream.frame, stream.terrain_datum)
        east, north, up = pose.position_enu
        pitch_rad = float(np.arcsin(pose.enu_from_camera[2, 2]))
        sizes.append(expected_person_px(up - terrain.height(east, north), pitch_rad, camera.fy))
    return float(np.median(sizes))


def _sites_exist(path: Path, mission: Mission, inventory: Inventory) -> None:
    sites = {site.id for site in inventory.sites}
    streams = {stream.id for stream in mission.streams}
    for number, stream in enumerate(mission.streams):
        if stream.site not in sites:
            raise InputError(
                f"{path} streams.{number}.site",
                repr(stream.site),
                f"a site of {mission.inventory}: {', '.join(sorted(sites))}",
            )
    require_streams(inventory, mission.inventory, streams, "the mission")


def _models_load(pool: Pool) -> None:
    for detector in pool.detectors:
        if detector.model is not None:
            open_pool_detector(detector)
