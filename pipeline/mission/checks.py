"""Checks of what a mission names: whether its parts fit together."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.config.inventory import Inventory, require_streams
from pipeline.config.mission import Mission, Stream
from pipeline.config.pool import Pool
from pipeline.detection import open_pool_detector
from pipeline.errors import InputError
from pipeline.geo.terrain import Terrain
from pipeline.ingest.track import Track
from pipeline.ingest.video.file import VideoInfo
from pipeline.mission.stages.source import StreamInput


def telemetry_covers(stream: Stream, video: VideoInfo, track: Track) -> None:
    """Raises InputError unless there is a pose for every picture of the video."""
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


def terrain_covers(mission: Mission, terrain: Terrain, stream: StreamInput) -> None:
    """Raises InputError unless there is known ground below the drone, once a second."""
    for time_s in np.arange(0.0, stream.video.duration_s - 1.0 / stream.video.frame_rate, 1.0):
        pose = stream.trajectory.pose(float(time_s))
        if pose is None:
            continue
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


def sites_exist(path: Path, mission: Mission, inventory: Inventory) -> None:
    """Raises InputError unless every stream is filmed at a site of the inventory."""
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


def models_load(pool: Pool) -> None:
    """Raises InputError unless every model of the pool opens."""
    for detector in pool.detectors:
        if detector.model is not None:
            open_pool_detector(detector)
