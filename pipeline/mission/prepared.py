"""Read and check everything a mission names, before anything is started."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipeline.allocation.build import build_problem
from pipeline.allocation.problem import Problem
from pipeline.config.inventory import Inventory, load_inventory
from pipeline.config.mission import Mission, load_mission
from pipeline.config.pool import Pool, PoolDetector, load_pool
from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.geo.search_area import load_search_area
from pipeline.geo.surfaces import load_mesh
from pipeline.geo.terrain import Terrain, frame_of, load_terrain
from pipeline.ingest.finding import Finding
from pipeline.ingest.track import Clock
from pipeline.ingest.trajectory_of import Ground
from pipeline.link.codec import require_codec
from pipeline.mission.checks import models_load, sites_exist, telemetry_covers, terrain_covers
from pipeline.mission.clocks import settled
from pipeline.mission.faults import Faults
from pipeline.mission.recording import Recording, read_recording
from pipeline.mission.stages.source import StreamInput
from pipeline.sensor.expected_size import expected_person_px


@dataclass(frozen=True, eq=False)
class Filmed:
    """All that a map needs beside detections; findings and left_out as in PreparedMission."""

    terrain: Terrain
    cameras: dict[str, Camera]
    streams: tuple[StreamInput, ...]
    findings: tuple[Finding, ...]
    left_out: Mapping[str, Mapping[str, int]]


@dataclass(frozen=True, eq=False)
class PreparedMission:
    """A mission whose every file was read and found usable.

    findings: what was noticed and assumed on the way. left_out: samples not used, stream -> reason -> count.
    """

    path: Path
    mission: Mission
    inventory: Inventory
    pool: Pool
    terrain: Terrain
    cameras: dict[str, Camera]
    streams: tuple[StreamInput, ...]
    problem: Problem
    findings: tuple[Finding, ...] = ()
    left_out: Mapping[str, Mapping[str, int]] = field(default_factory=dict)

    @property
    def clock(self) -> Clock:
        """Of all times of the run: UTC only if every stream's is."""
        return "utc" if all(s.trajectory.clock == "utc" for s in self.streams) else "local"

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

    Raises InputError, or SeveralInputsError with every independent fault, for what cannot be used.
    """
    mission = load_mission(path)
    faults = Faults()
    with faults.collected():
        inventory = load_inventory(mission.inventory)
        sites_exist(path, mission, inventory)
    with faults.collected():
        pool = load_pool(mission.pool)
        models_load(pool)
    with faults.collected():
        for codec in (mission.processing.codec, *mission.processing.codecs):
            require_codec(codec)
    filmed = read_filmed(path, mission, faults, thorough)
    terrain, cameras, streams = filmed.terrain, filmed.cameras, filmed.streams
    own_site = {s.id: s.site for s in mission.streams}
    person_px = {}
    if mission.processing.expected_size:
        person_px = {s.stream: _person_px(terrain, cameras[s.stream], s) for s in streams}
    problem = build_problem(own_site, mission.processing, inventory, pool, where=path, person_px=person_px)
    return PreparedMission(
        path, mission, inventory, pool, terrain, cameras, streams, problem, filmed.findings, filmed.left_out
    )


def read_filmed(path: Path, mission: Mission, faults: Faults, thorough: bool = False) -> Filmed:
    """What was filmed, and over which ground. Raises what ``faults`` has collected before and here."""
    with faults.collected():
        frame = _frame(mission)
        terrain = terrain_at(mission, frame, mission.fusion.cell_size)
    with faults.collected():
        if mission.search_area is not None:
            load_search_area(mission.search_area, _frame(mission))
    recordings = []
    for stream in mission.streams:
        with faults.collected():
            recordings.append(read_recording(path, mission, stream, thorough))
    faults.raise_if_any()
    streams, findings = _streams(mission, terrain, recordings, faults)
    faults.raise_if_any()
    cameras = {r.stream.id: r.camera for r in recordings}
    left_out = {r.stream.id: dict(r.track.left_out) for r in recordings if r.track.left_out}
    return Filmed(terrain, cameras, streams, tuple(findings), left_out)


def _streams(
    mission: Mission, terrain: Terrain, recordings: list[Recording], faults: Faults
) -> tuple[tuple[StreamInput, ...], list[Finding]]:
    """The streams on one clock and over the terrain, and what was noticed on the way."""
    ground = Ground(mission.terrain.height_datum, terrain.height)
    findings: list[Finding] = []
    flights = []
    for recording in recordings:
        with faults.collected():
            flights.append((recording, recording.trajectory(terrain.frame, ground)))
    settled_ones, of_clocks = settled([(r.stream.id, t, r.video.duration_s) for r, t in flights])
    streams = []
    for (recording, _), trajectory in zip(flights, settled_ones, strict=True):
        stream = StreamInput(
            stream=recording.stream.id,
            site=recording.stream.site,
            video=recording.video,
            trajectory=trajectory,
            processing_rate_hz=mission.processing.frame_rate,
            codec=mission.processing.codec,
        )
        findings += recording.findings(trajectory)
        with faults.collected():
            findings += telemetry_covers(recording.stream, recording.video, trajectory)
            findings += terrain_covers(mission, terrain, stream)
        streams.append(stream)
    return tuple(streams), findings + of_clocks


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
