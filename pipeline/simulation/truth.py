"""What only a simulation knows: where the people are, and what is visible of them in each picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

import numpy as np

from pipeline.geo.camera import Camera
from pipeline.geo.frame import LocalFrame
from pipeline.simulation.people import reference_point
from pipeline.simulation.person import Person
from pipeline.simulation.renderer import VisiblePerson
from pipeline.simulation.scene import Scene


@dataclass(frozen=True)
class LabelledFrame:
    """The visible people of one frame of a video."""

    index: int
    people: tuple[VisiblePerson, ...]


def people_geojson(scene: Scene, frame: LocalFrame, start: datetime, duration_s: float) -> dict[str, Any]:
    """A FeatureCollection: a Point for who rests, a LineString with a time for each point for who walks.

    Heights are above the ellipsoid.
    """
    return {
        "type": "FeatureCollection",
        "features": [_feature(person, scene, frame, start, duration_s) for person in scene.people],
    }


def _feature(
    person: Person, scene: Scene, frame: LocalFrame, start: datetime, duration_s: float
) -> dict[str, Any]:
    times = np.arange(0.0, duration_s + 0.5, 0.5) if person.speed_mps > 0.0 else np.zeros(1)
    points = np.array([reference_point(person, scene, float(t)) for t in times])
    latitude, longitude = frame.wgs84_from_enu(points[:, 0], points[:, 1])
    coordinates = [
        [round(float(lon), 9), round(float(lat), 9), round(float(z), 3)]
        for lon, lat, z in zip(longitude, latitude, points[:, 2], strict=True)
    ]
    properties: dict[str, Any] = {"id": person.id + 1, "class": "person", "body_model": person.model.name}
    if person.speed_mps == 0.0:
        return _geojson(person, "Point", coordinates[0], properties)
    properties["times"] = [(start + timedelta(seconds=float(t))).isoformat() for t in times]
    return _geojson(person, "LineString", coordinates, properties)


def _geojson(person: Person, kind: str, coordinates: Any, properties: dict[str, Any]) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "id": person.id + 1, "geometry": geometry, "properties": properties}


def boxes_coco(
    video: str, camera: Camera, frames: Sequence[LabelledFrame], start: datetime, frame_rate_hz: float
) -> dict[str, Any]:
    """COCO's format; each annotation also has visible_share, 0..1, full_bbox and person_id."""
    images = [
        {
            "id": frame.index,
            "file_name": f"{video}#{frame.index}",
            "frame_index": frame.index,
            "width": camera.width,
            "height": camera.height,
            "date_captured": (start + timedelta(seconds=frame.index / frame_rate_hz)).isoformat(),
        }
        for frame in frames
    ]
    seen = [(frame.index, person) for frame in frames for person in frame.people]
    return {
        "images": images,
        "annotations": [_annotation(k + 1, image, person) for k, (image, person) in enumerate(seen)],
        "categories": [{"id": 1, "name": "person"}],
    }


def _annotation(number: int, image: int, person: VisiblePerson) -> dict[str, Any]:
    bbox = _xywh(person.box_px)
    return {
        "id": number,
        "image_id": image,
        "category_id": 1,
        "bbox": bbox,
        "area": bbox[2] * bbox[3],
        "iscrowd": 0,
        "person_id": person.id + 1,
        "visible_share": round(person.visible_share, 4),
        "full_bbox": _xywh(person.full_box_px),
    }


def _xywh(box: tuple[float, float, float, float]) -> list[float]:
    return [box[0], box[1], box[2] - box[0], box[3] - box[1]]
