"""The mission that the contents of a folder make, with every assumption marked, as the text of a file."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import jinja2
import numpy as np
import yaml

from pipeline.config.base import FILL_IN, FORMAT_VERSION
from pipeline.config.terrain import Datum
from pipeline.geo.frame import LocalFrame
from pipeline.geo.surface_model import SurfaceModel, bounds_m
from pipeline.ingest.ground import window_about
from pipeline.ingest.track import Track

SITE = "here"
#: more pictures a second show the same person again
_MOST_RATE_HZ = 5.0
#: cells (m) by how well positions are known: looks scatter over cells that are finer than their error
_FINE_CELL_M, _COARSE_CELL_M, _FINE_SD_M = 0.5, 2.0, 0.1
#: a surface model farther than this from every flight shows nothing of it, metres
_REACH_M = 1000.0


@dataclass(frozen=True, eq=False)
class StreamDraft:
    """One stream of the mission. videos: in a row; none of a folder of stills. pairing: why not by name.

    camera: text of the section, may hold FILL IN. gimbal: whether the angles must be filled in. rate_hz: of the
    pictures. track: of its telemetry.
    """

    id: str
    videos: tuple[Path, ...] = ()
    stills: Path | None = None
    telemetry: Path | tuple[Path, ...] | None = None
    pairing: str = ""
    assumed: tuple[str, ...] = ()
    height: str = "absolute"
    height_datum: Datum | None = None
    height_reason: str = ""
    gimbal: bool = False
    camera: Path | str = ""
    camera_reason: str = ""
    rate_hz: float = _MOST_RATE_HZ
    track: Track | None = None


@dataclass(frozen=True, eq=False)
class MissionDraft:
    """All that the mission file says."""

    name: str
    streams: tuple[StreamDraft, ...]
    models: tuple[Path, ...]
    area: Path | None = None
    unused: dict[Path, str] = field(default_factory=dict)


def near_flights(
    models: Sequence[SurfaceModel], tracks: Sequence[Track], frame: LocalFrame
) -> list[SurfaceModel]:
    """The surface models that some flight is over or near; all of them if no flight is known."""
    window = window_about(tracks, frame, _REACH_M)
    if window is None:
        return list(models)
    west, south, east, north = window
    near = []
    for model in models:
        edges = bounds_m(model.path, frame)
        if edges[0] < east and edges[2] > west and edges[1] < north and edges[3] > south:
            near.append(model)
    return near


def mission_text(draft: MissionDraft, folder: Path) -> str:
    """The text of mission.yaml. folder: where it will lie; the paths in it are relative to that."""

    def relative(path: Path) -> str:
        return os.path.relpath(path.resolve(), folder.resolve())

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pipeline", "init"),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
        autoescape=False,
    )
    environment.filters["yaml"] = lambda files: (
        f"[{', '.join(_scalar(relative(f)) for f in files)}]"
        if isinstance(files, tuple)
        else _scalar(relative(files))
    )
    cell_m, reason = _cell(draft.streams)
    return environment.get_template("mission.yaml.j2").render(
        version=FORMAT_VERSION,
        name=_scalar(draft.name),
        models=draft.models,
        area=draft.area,
        streams=draft.streams,
        site=SITE,
        rate_hz=f"{min([_MOST_RATE_HZ, *(s.rate_hz for s in draft.streams)]):g}",
        latest_s=2,
        cell_m=f"{cell_m:g}",
        cell_reason=reason,
        cluster_m=f"{max(2.0, 1.5 * cell_m):g}",
        unused=[(_comment(relative(path)), _comment(why)) for path, why in draft.unused.items()],
    )


def fields_to_fill(text: str) -> list[str]:
    """The lines of a mission that a person must complete, with their numbers."""
    lines = enumerate(text.splitlines(), start=1)
    return [f"line {number}: {line.strip()}" for number, line in lines if FILL_IN in line.split("#")[0]]


def stream_name(path: Path, taken: Sequence[str]) -> str:
    """A name for a stream: that of its file, in the characters that a mission takes, and not taken yet."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", path.stem).strip("-") or "stream"
    number = 2
    unique = name
    while unique in taken:
        unique, number = f"{name}-{number}", number + 1
    return unique


def _cell(streams: Sequence[StreamDraft]) -> tuple[float, str]:
    stated = [s.track.horizontal_sd_m for s in streams if s.track is not None]
    if stated and all(sd is not None and np.nanmedian(sd) <= _FINE_SD_M for sd in stated):
        return _FINE_CELL_M, "fine, since the telemetry states positions to a decimetre (RTK)"
    return _COARSE_CELL_M, "assumed: positions are good to a metre or so; 0.5 m with RTK"


def _scalar(text: str) -> str:
    """A text as YAML's own scalar on one line."""
    return (
        str(yaml.safe_dump(text, width=10_000, allow_unicode=True)).removesuffix("\n").removesuffix("\n...")
    )


def _comment(text: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in text)
