"""``searchlight init``: from a folder of files to mission.yaml, inventory.yaml and pool.yaml."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from pipeline.config.camera import CameraSource
from pipeline.config.telemetry import Telemetry
from pipeline.config.terrain import Datum
from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.geoid import undulation_m
from pipeline.geo.surface_model import SurfaceModel
from pipeline.geo.terrain import load_terrain
from pipeline.ingest.cameras.choice import choose_camera
from pipeline.ingest.cameras.picture_facts import picture_facts
from pipeline.ingest.ground import middle_of
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.track import Track
from pipeline.ingest.video.file import VideoInfo
from pipeline.ingest.video.metadata import created_ns
from pipeline.ingest.video.recordings import open_recordings
from pipeline.init.contents import OURS, Contents, StillsFolder, contents_of
from pipeline.init.draft import (
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
from pipeline.init.recordings import in_rows
from pipeline.storage.whole_or_nothing import write_text

Progress = Callable[[str, int, int], None]
#: of ground that is looked at to know the height of a take-off, metres
_ABOUT_M = 20.0
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
        raise InputError(folder, "no video", "what a drone has filmed, or its stills in a folder")
    draft = draft_of(folder, contents)
    text = mission_text(draft, folder)
    write_measured_pool(folder / "pool.yaml", _first_picture(contents), progress)
    write_text(folder / "inventory.yaml", yaml.safe_dump(inventory_document(SITE), sort_keys=False))
    write_text(folder / "mission.yaml", text)
    to_fill = tuple(fields_to_fill(text))
    return InitResult(folder / "mission.yaml", len(draft.streams), to_fill, draft.unused)


def draft_of(folder: Path, contents: Contents) -> MissionDraft:
    """What the mission says, apart from how it is written."""
    began_ns = [created_ns(video.path) for video in contents.videos]
    inside = _inside([video.path for video in contents.videos])
    beside = contents.telemetry
    contents = replace(contents, telemetry={**inside, **beside})
    pairs = pair(contents.videos, contents.telemetry, began_ns)
    used = {p.telemetry for p in pairs if p.telemetry is not None}
    tracks = [contents.telemetry[path] for path in sorted(used)] + [s.track for s in contents.stills]
    near: list[SurfaceModel] = list(contents.surface_models)
    ground = None
    if tracks and near:
        frame = middle_of(tracks)
        near = near_flights(near, tracks, frame)
        ground = _ground_under(near, frame)
    unused = dict(contents.unused)
    unused |= {
        m.path: "a surface model far from every flight" for m in contents.surface_models if m not in near
    }
    of_inside = {path.with_suffix("") for path in used & inside.keys()}
    for path in beside.keys() - used:
        is_second = path.with_suffix("") in of_inside
        unused[path] = (
            "the video's own telemetry fits as well" if is_second else "telemetry that fits no video"
        )
    unused |= dict.fromkeys(contents.areas[1:], "a second search area")
    streams: list[StreamDraft] = []
    for row in in_rows(contents.videos, began_ns):
        videos = [contents.videos[k] for k in row]
        name = stream_name(videos[0].path, [s.id for s in streams])
        streams.append(_stream(name, videos, [pairs[k] for k in row], contents, ground))
    for stills in contents.stills:
        streams.append(
            _of_stills(stream_name(stills.path, [s.id for s in streams]), stills, contents, ground)
        )
    area = contents.areas[0] if contents.areas else None
    return MissionDraft(folder.resolve().name, tuple(streams), tuple(m.path for m in near), area, unused)


def _inside(videos: Sequence[Path]) -> dict[Path, Track]:
    """The telemetry of those videos that hold it themselves."""
    found = {}
    for path in videos:
        with suppress(InputError):
            track = read_telemetry(Telemetry(file=path))
            if track.has_position.any():
                found[path] = track
    return found


def _stream(
    name: str, videos: list[VideoInfo], pairs: list[Pair], contents: Contents, ground: Ground | None
) -> StreamDraft:
    found = pairs[0]
    track = None if found.telemetry is None else contents.telemetry[found.telemetry]
    height = HeightChoice("absolute", None, "") if track is None else _height(track, ground)
    size = videos[0].width, videos[0].height
    camera, reason, of_camera = _camera(videos[0].path, size, contents, track)
    return StreamDraft(
        id=name,
        videos=tuple(v.path for v in videos),
        telemetry=_files_of(pairs, contents),
        pairing=found.reason,
        assumed=(*(() if track is None else track.assumed), *of_camera),
        height=height.height,
        height_datum=height.height_datum,
        height_reason=height.reason,
        gimbal=track is not None and bool(np.isnan(track.pitch_rad).all()),
        camera=camera,
        camera_reason=reason,
        rate_hz=min(v.frame_rate for v in videos),
        track=track,
    )


def _of_stills(name: str, stills: StillsFolder, contents: Contents, ground: Ground | None) -> StreamDraft:
    """Their rate is nobody's: each is looked at once."""
    track, height = stills.track, _height(stills.track, ground)
    size = stills.source.width, stills.source.height
    camera, reason, of_camera = _camera(stills.path, size, contents, track)
    return StreamDraft(
        id=name,
        stills=stills.path,
        telemetry=stills.path,
        assumed=(*track.assumed, *of_camera),
        height=height.height,
        height_datum=height.height_datum,
        height_reason=height.reason,
        gimbal=bool(np.isnan(track.pitch_rad).all()),
        camera=camera,
        camera_reason=reason,
        track=track,
    )


def _files_of(pairs: list[Pair], contents: Contents) -> Path | tuple[Path, ...] | None:
    """The telemetry of a row of recordings: of each its own, if all have one on their clock, or else the first's."""
    files = tuple(p.telemetry for p in pairs if p.telemetry is not None)
    each_has_one = len(pairs) > 1 and len(files) == len(pairs)
    if each_has_one and all(contents.telemetry[file].tied_to_video for file in files):
        return files
    return pairs[0].telemetry


def _camera(
    path: Path, size: tuple[int, int], contents: Contents, track: Track | None
) -> tuple[Path | str, str, tuple[str, ...]]:
    """The calibration that lies there and fits pictures of a size, nothing where the metadata tell, or what a person
    must fill in; why; and what is assumed. path: of the video, or of the folder of stills.
    """
    fitting = [p for p, c in contents.cameras.items() if (c.width, c.height) == size]
    if len(fitting) == 1:
        return fitting[0], "", ()
    facts = picture_facts(path.name, size, () if path.is_dir() else (path,), track)
    try:
        return "", "", choose_camera(CameraSource(), facts).assumed
    except InputError as error:
        why = f"{len(fitting)} calibrations fit its pictures" if fitting else error.found
    return _CAMERA, f"{why}; its angle of view is on its data sheet", ()


def _height(track: Track, ground: Ground | None) -> HeightChoice:
    known = np.flatnonzero(track.has_position)
    latitude, longitude = float(track.latitude_deg[known[0]]), float(track.longitude_deg[known[0]])
    height_m = float("nan") if ground is None else ground.height_m(latitude, longitude)
    datum = "ellipsoid" if ground is None else ground.datum
    return choose_height(
        track, None if np.isnan(height_m) else height_m, datum, undulation_m(latitude, longitude)[0]
    )


@dataclass(frozen=True, eq=False)
class Ground:
    """datum: of the surface model's heights. height_m(latitude, longitude): of the ground, NaN where unknown."""

    datum: Datum
    height_m: Callable[[float, float], float]


def _ground_under(models: list[SurfaceModel], frame: LocalFrame) -> Ground | None:
    if not models:
        return None

    def height_m(latitude_deg: float, longitude_deg: float) -> float:
        east, north = (
            float(v) for v in frame.enu_from_wgs84(np.array(latitude_deg), np.array(longitude_deg))
        )
        window = (east - _ABOUT_M, north - _ABOUT_M, east + _ABOUT_M, north + _ABOUT_M)
        try:
            return load_terrain(models, 1.0, frame, window).height(east, north)
        except InputError:  # nothing is known just there
            return float("nan")

    return Ground(models[0].datum or "ellipsoid", height_m)


def _first_picture(contents: Contents) -> NDArray[np.uint8]:
    for video in contents.videos:
        for _, image in open_recordings([video.path]).images_at([0.0]):
            return image
    for stills in contents.stills:
        for _, image in stills.source.images_at([0.0]):
            return image
    return np.zeros((1080, 1920, 3), dtype=np.uint8)
