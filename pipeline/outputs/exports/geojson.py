"""GeoJSON (RFC 7946): the places with names, in order of probability, then what is known of the ground."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pipeline.outputs.exports.view import Place, RunView, Shape
from pipeline.outputs.exports.words import clean, in_video, what_to_do
from pipeline.storage.whole_or_nothing import write_text


def write_geojson(folder: Path, view: RunView) -> list[str]:
    """Write ``places.geojson``. A height is above WGS84's ellipsoid, or there is none."""
    shapes = [
        *(("search area", s) for s in view.areas),
        *(("track", s) for s in view.tracks),
        *(("second look", s) for s in view.second_look),
    ]
    document: dict[str, Any] = {"type": "FeatureCollection", "mission": clean(view.mission)}
    document |= {"verdict": clean(view.verdict)} | ({"redacted": view.redacted} if view.redacted else {})
    document["features"] = [_place(p, view) for p in view.places] + [_shape(*pair) for pair in shapes]
    write_text(
        folder / "places.geojson", json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    )
    return ["places.geojson"]


def position(place: Place) -> list[float]:
    """Longitude, latitude, and the height above the ellipsoid where it is known."""
    point = [round(place.longitude_deg, 8), round(place.latitude_deg, 8)]
    return point if place.ellipsoidal_m is None else [*point, round(place.ellipsoidal_m, 3)]


def _place(place: Place, view: RunView) -> dict[str, Any]:
    error, utm = place.error, place.utm
    said: dict[str, Any] = {
        "name": place.name,
        "kind": place.kind,
        "rank": place.rank,
        "what_to_do": what_to_do(place),
        "decided": [clean(sentence) for sentence in place.decided],
        "class": clean(place.class_name),
        "probability": place.probability,
        "expected_people": place.expected_people,
        "may_be_same_person_as": list(place.may_be),
        "mgrs": place.mgrs,
        "seen_from": place.first_seen,
        "seen_to": place.last_seen,
        "clock": place.clock,
        "looks": place.looks,
        "sightings": place.sightings,
    }
    if utm is not None and not view.redacted:
        said["utm"] = utm.text
    if place.height_m is not None:
        said |= {"height_m": place.height_m, "height_datum": place.height_datum}
    if error is not None:
        said["error_ellipse_95"] = {
            "semi_major_m": error.semi_major_m,
            "semi_minor_m": error.semi_minor_m,
            "orientation_deg": error.orientation_deg,
        }
    if place.streams:
        said["streams"] = [clean(stream) for stream in place.streams]
    said["in_video"] = [clean(where) for where in map(in_video, place.pictures) if where]
    return {
        "type": "Feature",
        "id": place.id,
        "geometry": {"type": "Point", "coordinates": position(place)},
        "properties": said,
    }


def _shape(kind: str, shape: Shape) -> dict[str, Any]:
    said = {"name": clean(shape.name), "kind": kind} | ({"why": clean(shape.why)} if shape.why else {})
    return {"type": "Feature", "geometry": shape.geometry, "properties": said}
