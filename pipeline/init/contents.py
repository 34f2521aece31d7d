"""What lies in a folder: videos, telemetry, stills, surface models, search areas; and what is not used, and why."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.config.camera import load_camera
from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.geo.camera import Camera
from pipeline.geo.surface_model import SurfaceModel, inspect
from pipeline.ingest.registry import read_telemetry
from pipeline.ingest.telemetry.stills_metadata import dated_stills, read_stills
from pipeline.ingest.track import Track
from pipeline.ingest.video.file import VideoInfo, open_video
from pipeline.ingest.video.stills import StillsSource, open_stills

VIDEO_ENDINGS = frozenset({".mp4", ".mov", ".mkv", ".avi", ".ts", ".m4v", ".mts"})
STILL_ENDINGS = frozenset({".jpg", ".jpeg"})
RASTER_ENDINGS = frozenset({".tif", ".tiff", ".vrt"})
AREA_ENDINGS = frozenset({".geojson", ".kml", ".kmz"})
CAMERA_ENDINGS = frozenset({".yaml", ".yml", ".xml"})
#: a folder with fewer stills is an album, not a flight
LEAST_STILLS = 5
#: an SD card's folders are not deeper
_DEEPEST = 6
_MOST_FILES = 100_000


@dataclass(frozen=True, eq=False)
class StillsFolder:
    """A folder of stills that say where they were taken."""

    path: Path
    track: Track
    source: StillsSource


@dataclass(frozen=True, eq=False)
class Contents:
    """What was found, each list in the order of the paths. unused: path -> why it is not used."""

    videos: tuple[VideoInfo, ...]
    telemetry: dict[Path, Track]
    stills: tuple[StillsFolder, ...]
    surface_models: tuple[SurfaceModel, ...]
    cameras: dict[Path, Camera]
    areas: tuple[Path, ...]
    unused: dict[Path, str]


def contents_of(folder: Path) -> Contents:
    """Look at every file below a folder. Raises InputError if there is no such folder."""
    if not folder.is_dir():
        raise InputError(folder, "no folder", "a folder with video, telemetry and a surface model")
    videos, telemetry, models, areas, cameras = [], {}, [], [], {}
    stills: dict[Path, int] = {}
    unused: dict[Path, str] = {}
    for path in _files(folder):
        ending = path.suffix.lower()
        try:
            if ending in VIDEO_ENDINGS:
                videos.append(open_video(path))
            elif ending in STILL_ENDINGS:
                stills[path.parent] = stills.get(path.parent, 0) + 1
            elif ending in RASTER_ENDINGS:
                models.append(inspect(path))
            elif ending in AREA_ENDINGS:
                areas.append(path)
            elif ending in CAMERA_ENDINGS:
                cameras[path] = load_camera(path)
            else:
                track = read_telemetry(Telemetry(file=path))
                if track.has_position.any():
                    telemetry[path] = track
                else:
                    unused[path] = f"{len(track.times_s)} samples, none with a position"
        except InputError as error:
            unused[path] = error.found
    flown = _flown(stills, unused)
    return Contents(tuple(videos), telemetry, flown, tuple(models), cameras, tuple(areas), unused)


def _flown(stills: dict[Path, int], unused: dict[Path, str]) -> tuple[StillsFolder, ...]:
    """Folders of a flight's stills; why others are not used. stills: how many lie in each."""
    flown = []
    for album, count in stills.items():
        if count < LEAST_STILLS:
            unused[album] = f"{count} stills; a flight has at least {LEAST_STILLS}"
            continue
        try:
            stills_folder = _stills(album)
        except InputError as error:
            unused[album] = error.found
            continue
        if stills_folder.track.has_position.any():
            flown.append(stills_folder)
        else:
            unused[album] = f"{count} stills, none with a position"
    return tuple(flown)


def _stills(folder: Path) -> StillsFolder:
    track = read_stills(folder)
    pictures, _ = dated_stills(folder)
    source = open_stills(tuple(s.path for s in pictures), np.arange(len(pictures), dtype=np.float64))
    return StillsFolder(folder, track, source)


def _files(folder: Path) -> Iterator[Path]:
    """Every file that is not hidden, by name; what is ours from an earlier start is not looked at."""
    count = 0
    for here, folders, names in os.walk(folder):
        depth = len(Path(here).relative_to(folder).parts)
        folders[:] = sorted(f for f in folders if not f.startswith(".") and depth < _DEEPEST)
        if "summary.json" in names:  # an earlier run's results
            folders[:] = []
            continue
        for name in sorted(names):
            count += 1
            if count > _MOST_FILES:
                raise InputError(folder, f"more than {_MOST_FILES} files", "the folder of one search")
            if not name.startswith(".") and name not in OURS:
                yield Path(here) / name


#: what init writes
OURS = frozenset({"mission.yaml", "inventory.yaml", "pool.yaml"})
