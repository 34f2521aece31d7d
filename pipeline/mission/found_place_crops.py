"""What made us believe it: for each found or possible place, the piece of the picture with the surest sighting."""

from __future__ import annotations

import io
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib import image as matplotlib_image

from pipeline.errors import SearchlightError, in_one_line
from pipeline.fusion.look import Look
from pipeline.fusion.salient import SalientLocation
from pipeline.geo.camera import Camera
from pipeline.ingest.in_file import InFile, in_file
from pipeline.logs import Log
from pipeline.messages import FloatArray
from pipeline.mission.near_files import Near, here
from pipeline.mission.prepared import PreparedMission
from pipeline.mission.stages.source import StreamInput

_LOG = Log("mission")
HALF_SIZE_PX = 72
#: what ``Look.order`` is
Order = tuple[int, str, str, int]


@dataclass(frozen=True, eq=False)
class Crop:
    """place: its id. sighting: the surest one there. png: what was seen. at: where in the video; None: not known."""

    place: int
    sighting: Look
    png: bytes = field(repr=False)
    at: InFile | None = None


def found_place_crops(
    prepared: PreparedMission, locations: Sequence[SalientLocation], near: Near = here
) -> list[Crop]:
    """One for every place that has a sighting in the mission's streams, cut from the video, by place.

    near: cuts them where the videos are. The map is worth more than its pictures: those of a drone that is gone are
    left out, and the log says so.

    Places that only earlier flights have seen keep the picture of then.
    """
    streams = {stream.stream for stream in prepared.streams}
    chosen = {place.id: look for place in locations if (look := _best(place, streams)) is not None}
    pictures: list[Crop] = []
    for stream in prepared.streams:
        mine = {place: look for place, look in chosen.items() if look.stream == stream.stream}
        if mine:
            pictures += _cut_near(stream, prepared.cameras[stream.stream], mine, near)
    if prepared.onto is not None:
        left = [place for place in locations if place.id not in {crop.place for crop in pictures}]
        pictures += _kept(left, prepared.onto.crops)
    return sorted(pictures, key=lambda crop: crop.place)


def _cut_near(stream: StreamInput, camera: Camera, looks: dict[int, Look], near: Near) -> list[Crop]:
    if near is here:
        return _cut(stream, camera, looks)
    try:
        return near(stream.site, _cut, stream, camera, looks)
    except SearchlightError as error:
        _LOG.warning("no pictures of places", stream=stream.stream, error=in_one_line(error))
        return []


def _kept(places: Sequence[SalientLocation], crops: Mapping[Order, bytes]) -> list[Crop]:
    found = []
    for place in places:
        seen = [sighting for sighting in place.sightings if sighting.order in crops]
        if seen:
            best = max(seen, key=lambda look: (look.score, -look.time_ns))
            found.append(Crop(place.id, best, crops[best.order]))
    return found


def _best(place: SalientLocation, streams: Collection[str]) -> Look | None:
    mine = [sighting for sighting in place.sightings if sighting.stream in streams]
    return max(mine, key=lambda look: (look.score, -look.time_ns), default=None)


def _cut(stream: StreamInput, camera: Camera, looks: dict[int, Look]) -> list[Crop]:
    time_s_of = {place: (look.time_ns - stream.start_ns) * 1e-9 for place, look in looks.items()}
    pictures: list[Crop] = []
    for time_s, image in stream.source.images_at(time_s_of.values()):
        pose = stream.trajectory.pose(time_s)
        if pose is None:
            continue
        for place in (p for p, t in time_s_of.items() if t == time_s):
            pixel = camera.project_enu(looks[place].intersection_enu[None], pose)[0]
            at = in_file(stream.source, time_s)
            pictures.append(Crop(place, looks[place], _crop(image, pixel), at))
    return pictures


def _crop(image: np.ndarray[tuple[int, ...], np.dtype[np.uint8]], pixel: FloatArray) -> bytes:
    # the point is where the person touches the ground: most of the person is above it
    height, width = image.shape[:2]
    x = int(np.clip(pixel[0] - HALF_SIZE_PX, 0, width - 2 * HALF_SIZE_PX))
    y = int(np.clip(pixel[1] - 1.4 * HALF_SIZE_PX, 0, height - 2 * HALF_SIZE_PX))
    buffer = io.BytesIO()
    matplotlib_image.imsave(buffer, image[y : y + 2 * HALF_SIZE_PX, x : x + 2 * HALF_SIZE_PX], format="png")
    return buffer.getvalue()
