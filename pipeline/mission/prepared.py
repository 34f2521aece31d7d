"""Read and check everything a mission names, before anything is started."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pipeline.allocation.build import build_problem
from pipeline.allocation.problem import Problem
from pipeline.config.inventory import Inventory, load_inventory
from pipeline.config.mission import Mission, load_mission
from pipeline.config.pool import Pool, PoolDetector, load_pool
from pipeline.geo.camera import Camera
from pipeline.geo.cover import CoverFile, with_cover
from pipeline.geo.frame import LocalFrame
from pipeline.geo.heights import UNKNOWN, Heights
from pipeline.geo.search_area import load_search_area
from pipeline.geo.terrain import Terrain
from pipeline.ingest.checks.exchanged_axes import require_axes_in_order
from pipeline.ingest.finding import Finding
from pipeline.ingest.ground import GroundModel, Window, files_of, frame_over, load_ground, window_about
from pipeline.ingest.resolution import with_resolution
from pipeline.ingest.track import Clock, Track
from pipeline.link.codec import require_codec
from pipeline.logs import Log
from pipeline.mission.checks import (
    area_is_on_terrain,
    prior_is_on_terrain,
    require_near,
    sites_exist,
    telemetry_covers,
    terrain_covers,
)
from pipeline.mission.clocks import settled
from pipeline.mission.detectors import layers_of, look_at_detectors
from pipeline.mission.faults import Faults
from pipeline.mission.live_stream import LiveRecording, read_live
from pipeline.mission.near_files import Near, here
from pipeline.mission.onto import EarlierRun, joined, require_continues, require_fits
from pipeline.mission.recording import Recording, open_source, read_recording
from pipeline.mission.sent_size import as_sent
from pipeline.mission.simulated_only import simulated_only
from pipeline.mission.stages.source import StreamInput
from pipeline.sensor.expected_size import expected_person_px
from pipeline.sensor.model import SensorModel

_INGEST = Log("ingest")
#: people are not looked for farther away than this, metres
_MOST_REACH_M = 3000.0


@dataclass(frozen=True, eq=False)
class Filmed:
    """All that a map needs beside detections; findings and left_out as in PreparedMission."""

    mission: Mission
    terrain: Terrain
    cameras: dict[str, Camera]
    streams: tuple[StreamInput, ...]
    findings: tuple[Finding, ...]
    left_out: Mapping[str, Mapping[str, int]]
    tracks: Mapping[str, Track]
    heights: Heights


@dataclass(frozen=True, eq=False)
class PreparedMission:
    """A mission whose every file was read and found usable.

    findings: what was noticed and assumed on the way. left_out: samples not used, stream -> reason -> count.
    known_layers: of the map, by name, of every detector of the pool that has a model. tracks: the samples of each
    stream. heights: what the map's heights count from. onto: the run whose map goes on.
    input_sizes: width and height of the input of every network of the pool, by the detector's id; None: any.
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
    known_layers: Mapping[str, frozenset[str]] = field(default_factory=dict)
    tracks: Mapping[str, Track] = field(default_factory=dict)
    heights: Heights = UNKNOWN
    onto: EarlierRun | None = None
    input_sizes: Mapping[str, tuple[int, int] | None] = field(default_factory=dict)

    @property
    def clock(self) -> Clock:
        """Of all times of the run: UTC only if every stream's is; unknown if no stream has a date."""
        clocks = {s.trajectory.clock for s in self.streams}
        return clocks.pop() if len(clocks) == 1 else "local"

    @property
    def frame(self) -> LocalFrame:
        """The map frame."""
        return self.terrain.frame

    @property
    def layers(self) -> dict[str, int]:
        """The ids of the map's layers by name."""
        return layers_of(self.mission)

    @property
    def relative_accuracy(self) -> dict[str, float]:
        """The paper's p_det_rel of every pool detector: its best accuracy over the best of the pool."""
        best = {d.id: d.best_accuracy for d in self.pool.detectors}
        return {name: accuracy / max(best.values()) for name, accuracy in best.items()}

    def runnable(self, pool_detector: str) -> PoolDetector:
        """A pool detector that has a model."""
        detector = next(d for d in self.pool.detectors if d.id == pool_detector)
        detector.require_model(f"{self.mission.pool} {pool_detector}.model")
        return detector


def prepare(path: Path, onto: EarlierRun | None = None, near: Near = here) -> PreparedMission:
    """Read and check a mission; of a video its index and a few pictures. onto: the run whose map is to go on.

    near: reads what a stream names where that is; all else is read here.

    Raises InputError, or SeveralInputsError with every independent fault, for what cannot be used.
    """
    mission = load_mission(path)
    faults = Faults()
    with faults.collected():
        inventory = load_inventory(mission.inventory)
        sites_exist(path, mission, inventory)
    with faults.collected():
        pool = load_pool(mission.pool)
        look = look_at_detectors(pool, layers_of(mission), mission.pool)
    with faults.collected():
        for codec in (mission.processing.codec, *mission.processing.codecs):
            require_codec(codec)
    filmed = read_filmed(path, mission, faults, onto, near)
    mission, terrain, cameras, streams = filmed.mission, filmed.terrain, filmed.cameras, filmed.streams
    streams = tuple(replace(s, source=as_sent(s.source, look.picture_sizes.values())) for s in streams)
    files = [(s.site, file) for s in streams for file in s.source.paths or (s.path,)]
    unfit = simulated_only(look.simulated, files, near)
    own_site = {s.id: s.site for s in mission.streams}
    person_px = {}
    if mission.processing.expected_size:
        person_px = {s.stream: _person_px(terrain, cameras[s.stream], s) for s in streams}
    _log(filmed)
    problem = build_problem(own_site, mission.processing, inventory, pool, where=path, person_px=person_px)
    return PreparedMission(
        path,
        mission,
        inventory,
        pool,
        terrain,
        cameras,
        streams,
        problem,
        (*look.findings, *unfit, *filmed.findings),
        filmed.left_out,
        look.known,
        filmed.tracks,
        filmed.heights,
        onto,
        look.input_sizes,
    )


def _log(filmed: Filmed) -> None:
    """A line for each stream that was read, for the map, and for everything that was noticed or assumed."""
    for stream in filmed.streams:
        first_s, last_s = stream.trajectory.span_s
        _INGEST.event(
            "stream read",
            stream=stream.stream,
            pictures=stream.video.pictures,
            seconds=None if stream.is_live else round(stream.end_s, 3),
            poses_from_s=round(first_s, 3),
            poses_to_s=round(last_s, 3),
            takeoff_m=round(stream.trajectory.takeoff_m, 2),
        )
    terrain = filmed.terrain
    _INGEST.event(
        "terrain read", cells=terrain.shape, cell_m=terrain.cell_m, heights_above=filmed.heights.name
    )
    for finding in filmed.findings:
        log = _INGEST.warning if finding.severity == "warning" else _INGEST.event
        log(finding.cause, where=finding.where, found=finding.found)


def read_filmed(
    path: Path, mission: Mission, faults: Faults, onto: EarlierRun | None = None, near: Near = here
) -> Filmed:
    """What was filmed, and over which ground. Raises what ``faults`` has collected before and here.

    onto: a run whose map is to hold it: in its frame, on a terrain that holds both.
    """
    recordings = _recordings(path, mission, faults, near)
    tracks = [r.track for r in recordings]
    with faults.collected():
        _require_axes(mission, recordings)  # before ground is looked for between them
        frame = frame_over(mission.terrain, tracks, None if onto is None else onto.frame)
        window = _seen(mission, frame, recordings)
        if onto is not None:
            require_fits(onto, mission.fusion, frame)
            window = joined(window, onto.window)
        ground = load_ground(mission.terrain, mission.fusion.cell_size, frame, window, tracks)
    faults.raise_if_any()
    mission = _with_ground_sd(mission, ground.sd_m)
    with faults.collected():
        ground = replace(ground, terrain=with_cover(ground.terrain, _cover_files(mission)))
    terrain = ground.terrain
    streams, findings = _streams(mission, ground, recordings, faults)
    if mission.search_area is not None:
        with faults.collected():
            findings += area_is_on_terrain(mission.search_area, terrain)
    if mission.prior is not None:
        with faults.collected():
            findings += prior_is_on_terrain(mission.prior, terrain)
    if onto is not None:
        with faults.collected():
            require_continues(onto, mission.fusion, ground, streams)
    faults.raise_if_any()
    cameras = {r.stream.id: r.camera for r in recordings}
    left_out = {r.stream.id: dict(r.track.left_out) for r in recordings if r.track.left_out}
    by_stream = {r.stream.id: r.track for r in recordings}
    return Filmed(mission, terrain, cameras, streams, tuple(findings), left_out, by_stream, ground.heights)


def _cover_files(mission: Mission) -> list[CoverFile]:
    return [CoverFile(c.file, c.hidden, 100.0 if c.unit == "percent" else 1.0) for c in mission.cover]


def _recordings(
    path: Path, mission: Mission, faults: Faults, near: Near
) -> Sequence[Recording | LiveRecording]:
    """Of all streams. The next video is opened and probed, outside of Python, while telemetry is read."""
    if mission.is_live or near is not here:
        return _recordings_at_once(path, mission, faults, near)
    recordings = []
    with ThreadPoolExecutor(1) as pool:
        opening = [pool.submit(open_source, mission, stream) for stream in mission.streams]
        for stream, opened in zip(mission.streams, opening, strict=True):
            with faults.collected():
                recordings.append(read_recording(path, mission, stream, opened.result))
    return recordings


def _recordings_at_once(
    path: Path, mission: Mission, faults: Faults, near: Near
) -> list[Recording | LiveRecording]:
    """All are waited for at once, each where its files are."""
    read: Callable[..., Recording | LiveRecording] = read_live if mission.is_live else read_recording
    with ThreadPoolExecutor(len(mission.streams)) as pool:
        looking = [pool.submit(near, stream.site, read, path, mission, stream) for stream in mission.streams]
        recordings = []
        for looked in looking:
            with faults.collected():
                recordings.append(looked.result())
    return recordings


def _require_axes(mission: Mission, recordings: Sequence[Recording | LiveRecording]) -> None:
    if mission.terrain.flat is None and mission.terrain.origin is None:
        files = files_of(mission.terrain)
        for recording in recordings:
            require_axes_in_order(recording.stream.telemetry.file, recording.track, files)


def _live_streams(
    mission: Mission, ground: GroundModel, recordings: Sequence[LiveRecording], faults: Faults
) -> tuple[tuple[StreamInput, ...], list[Finding]]:
    """As _streams: they are on one clock already."""
    streams, findings = [], list(ground.findings)
    for recording in recordings:
        with faults.collected():
            source = recording.source(ground.terrain.frame, ground.ground, mission.fusion.uncertainty)
            findings += recording.findings(source.way)
            stream = StreamInput(
                recording.stream.id,
                recording.stream.site,
                source,
                source.way,
                mission.processing.frame_rate,
                mission.processing.codec,
            )
            findings += terrain_covers(mission, ground.terrain, stream)
            streams.append(stream)
    return tuple(streams), findings


def _streams(
    mission: Mission, ground: GroundModel, recordings: Sequence[Recording | LiveRecording], faults: Faults
) -> tuple[tuple[StreamInput, ...], list[Finding]]:
    """The streams on one clock and over the terrain, and what was noticed on the way."""
    live = [r for r in recordings if isinstance(r, LiveRecording)]
    if live:
        return _live_streams(mission, ground, live, faults)
    return _recorded_streams(mission, ground, [r for r in recordings if isinstance(r, Recording)], faults)


def _recorded_streams(
    mission: Mission, ground: GroundModel, recordings: Sequence[Recording], faults: Faults
) -> tuple[tuple[StreamInput, ...], list[Finding]]:
    terrain = ground.terrain
    findings = list(ground.findings)
    flights = []
    for recording in recordings:
        with faults.collected():
            trajectory, coarse = with_resolution(
                recording.trajectory(terrain.frame, ground.ground, mission.fusion.uncertainty),
                recording.track,
                recording.stream.telemetry,
            )
            flights.append((recording, trajectory))
            findings += coarse
    settled_ones, of_clocks = settled([(r.stream.id, t, r.video.end_s) for r, t in flights])
    streams = []
    for (recording, _), trajectory in zip(flights, settled_ones, strict=True):
        stream = StreamInput(
            stream=recording.stream.id,
            site=recording.stream.site,
            source=recording.video,
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


def terrain_at(prepared: PreparedMission, cell_m: float) -> Terrain:
    """The mission's terrain in cells of another size."""
    old = prepared.terrain
    rows, columns = old.shape
    window = (old.east_m, old.north_m, old.east_m + columns * old.cell_m, old.north_m + rows * old.cell_m)
    tracks = list(prepared.tracks.values())
    return load_ground(prepared.mission.terrain, cell_m, prepared.frame, window, tracks).terrain


def _seen(
    mission: Mission, frame: LocalFrame, recordings: Sequence[Recording | LiveRecording]
) -> Window | None:
    """The part of the map frame that matters: what the cameras can see, and what is to be searched.

    A live stream's drone will fly farther than it has.
    """
    reach_m = max((_reach_m(mission, r.camera) + _range_m(r) for r in recordings), default=0.0)
    window = window_about([r.track for r in recordings], frame, reach_m)
    if mission.search_area is None or window is None:
        return window
    west, south, east, north = load_search_area(mission.search_area, frame).bounds_m
    require_near(mission.search_area, (west, south, east, north), window)
    return min(west, window[0]), min(south, window[1]), max(east, window[2]), max(north, window[3])


def _range_m(recording: Recording | LiveRecording) -> float:
    return recording.stream.live.range if isinstance(recording, LiveRecording) else 0.0


def _reach_m(mission: Mission, camera: Camera) -> float:
    models = [SensorModel(camera, mission.fusion, of_class) for of_class in mission.fusion.classes]
    return min(_MOST_REACH_M, max(model.max_distance_m for model in models) + 10.0 * mission.fusion.cell_size)


def _with_ground_sd(mission: Mission, sd_m: float) -> Mission:
    """The mission, its places less sure by the error of a plane that stands for the terrain."""
    if not sd_m:
        return mission
    uncertainty = mission.fusion.uncertainty.model_copy(
        update={"terrain": math.hypot(mission.fusion.uncertainty.terrain, sd_m)}
    )
    return mission.model_copy(
        update={"fusion": mission.fusion.model_copy(update={"uncertainty": uncertainty})}
    )


def _person_px(terrain: Terrain, camera: Camera, stream: StreamInput) -> float:
    """The size of a person to be expected in the stream's pictures: the median over its seconds."""
    sizes = []
    for time_s in stream.seconds_s:
        pose = stream.trajectory.pose(float(time_s))
        if pose is None:
            continue
        east, north, up = pose.position_enu
        pitch_rad = float(np.arcsin(pose.enu_from_camera[2, 2]))
        sizes.append(
            expected_person_px(up - terrain.height(east, north), pitch_rad, camera.fy * pose.focal_scale)
        )
    return float(np.median(sizes))
