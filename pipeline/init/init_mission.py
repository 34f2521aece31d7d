"""``searchlight init``: from a folder of files to mission.yaml, inventory.yaml and pool.yaml."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.geo.terrain import Terrain, frame_of, load_terrain
from pipeline.ingest.track import Track
from pipeline.ingest.video.file import VideoInfo, read_frames
from pipeline.init.contents import OURS, Contents, contents_of
from pipeline.init.draft import (
    FILL_IN,
    SITE,
    MissionDraft,
    StreamDraft,
    fields_to_fill,
    mission_text,
    near_flights,
    stream_name,
)
from pipeline.init.heights import HeightChoice, choose_height
from pipeline.init.machine import inventory_document, write_measured_pool
from pipeline.init.pairing import Pair, pair
from pipeline.init.recordings import created_ns, in_rows
from pipeline.storage.whole_or_nothing import write_text

Progress = Callable[[str, int, int], None]
_CAMERA = "{field_of_view: {degrees: FILL IN, of: horizontal}}"


@dataclass(frozen=True)
class InitResult:
    """mission: the file that was written. to_fill: its lines that a person must complete. unused: path -> why."""

    mission: Path
    streams: int
    to_fill: tuple[str, ...]
    unused: dict[Path, str]


def init_mission(folder: Path, progress: Progress) -> InitResult:
    """Write the three files into the folder. Raises InputError if one is there, or if there is nothing to search."""
    for name in sorted(OURS):
        if (folder / name).exists():
            raise InputError(folder / name, "a file that is there already", "none: remove it to begin anew")
    contents = contents_of(folder)
    if not contents.videos and not contents.stills:
        raise InputError(folder, "no video and no folder of stills", "what a drone has filmed")
    text = mission_text(draft_of(folder, contents), folder)
    write_measured_pool(folder / "pool.yaml", _first_picture(contents), progress)
    write_text(folder / "inventory.yaml", yaml.safe_dump(inventory_document(SITE), sort_keys=False))
    write_text(folder / "mission.yaml", text)
    count = len(contents.videos) + len(contents.stills)
    return InitResult(folder / "mission.yaml", count, tuple(fields_to_fill(text)), contents.unused)


def draft_of(folder: Path, contents: Contents) -> MissionDraft:
    """What the mission says, apart from how it is written."""
    began_ns = [created_ns(video) for video in contents.videos]
    pairs = pair(contents.videos, contents.telemetry, began_ns)
    used = {p.telemetry for p in pairs if p.telemetry is not None}
    tracks = [contents.telemetry[path] for path in used]
    near = near_flights(contents.surface_models, tracks)
    unused = dict(contents.unused)
    unused |= {
        m.path: "a surface model far from every flight" for m in contents.surface_models if m not in near
    }
    unused |= {path: "telemetry that fits no video" for path in contents.telemetry if path not in used}
    unused |= dict.fromkeys(contents.areas[1:], "a second search area")
    terrain = _terrain(near[0].path) if near else None
    streams: list[StreamDraft] = []
    for row in in_rows(contents.videos, began_ns):
        videos = [contents.videos[k] for k in row]
        name = stream_name(videos[0].path, [s.id for s in streams])
        streams.append(_stream(name, videos, pairs[row[0]], contents, terrain))
    for stills in contents.stills:
        name = stream_name(stills, [s.id for s in streams])
        streams.append(StreamDraft(id=name, stills=stills))
    area = contents.areas[0] if contents.areas else None
    return MissionDraft(folder.resolve().name, tuple(streams), tuple(m.path for m in near), area, unused)


def _stream(
    name: str, videos: list[VideoInfo], found: Pair, contents: Contents, terrain: Terrain | None
) -> StreamDraft:
    track = None if found.telemetry is None else contents.telemetry[found.telemetry]
    height = HeightChoice("absolute", None, "") if track is None else _height(track, terrain)
    return StreamDraft(
        id=name,
        videos=tuple(v.path for v in videos),
        telemetry=found.telemetry,
        pairing=found.reason,
        assumed=() if track is None else track.assumed,
        height=height.height,
        height_datum=height.height_datum,
        height_reason=height.reason,
        gimbal=track is not None and bool(np.isnan(track.pitch_rad).all()),
        camera=_CAMERA,
        camera_reason=f"{FILL_IN}: the camera is not known; its angle of view is on its data sheet",
        rate_hz=min(v.frame_rate for v in videos),
        track=track,
    )


def _height(track: Track, terrain: Terrain | None) -> HeightChoice:
    ground_m = None
    if terrain is not None:
        known = np.flatnonzero(np.isfinite(track.latitude_deg))
        east, north = terrain.frame.enu_from_wgs84(
            track.latitude_deg[known[:1]], track.longitude_deg[known[:1]]
        )
        height_m = terrain.height(float(east[0]), float(north[0])) if len(known) else float("nan")
        ground_m = None if np.isnan(height_m) else height_m
    return choose_height(track, ground_m, "ellipsoid", 0.0)


def _terrain(path: Path) -> Terrain:
    return load_terrain(path, 2.0, frame_of(path))


def _first_picture(contents: Contents) -> NDArray[np.uint8]:
    for video in contents.videos:
        for _, _, image in read_frames(video.path, (0,)):
            return image
    return np.zeros((1080, 1920, 3), dtype=np.uint8)
