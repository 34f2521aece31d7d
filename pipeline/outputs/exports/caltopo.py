"""CalTopo's and SARTopo's GeoJSON: markers and shapes in folders, as their import takes them."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from pipeline.outputs.exports.view import Place, RunView, Shape
from pipeline.outputs.exports.words import COLORS, clean, outline, said_of
from pipeline.storage.whole_or_nothing import write_text


def write_caltopo(folder: Path, view: RunView) -> list[str]:
    """Write ``caltopo.json``: GeoJSON whose properties are CalTopo's (class, title, folderId, marker-*, stroke ..)."""
    features: list[dict[str, Any]] = []
    for title, items in (
        ("Places", [f for p in view.found for f in _place(p, view)]),
        ("Possible places", [f for p in view.possible for f in _place(p, view)]),
        ("Search area", [_shape(s, "#0072B2", 0.0) for s in view.areas]),
        ("Drones' ways", [_shape(s, "#56B4E9", 0.0) for s in view.tracks]),
        ("Worth a second look", [_shape(s, "#CC79A7", 0.2) for s in view.second_look]),
    ):
        if items:
            name = clean(f"{view.mission}: {title}")
            folder_id = _id(name)
            features.append(_feature(folder_id, None, {"class": "Folder", "title": name}))
            for number, (geometry, said) in enumerate(items):
                features.append(_feature(_id(f"{name} {number}"), geometry, said | {"folderId": folder_id}))
    text = json.dumps({"type": "FeatureCollection", "features": features}, indent=1, ensure_ascii=False)
    write_text(folder / "caltopo.json", text + "\n")
    return ["caltopo.json"]


def _place(place: Place, view: RunView) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    color = COLORS[place.kind]
    said = {
        "class": "Marker",
        "title": place.name,
        "description": "\n".join(f"{label}: {text}" for label, text in said_of(place, view)),
        "marker-symbol": "point",
        "marker-color": color,
        "marker-size": "1",
    }
    point = {"type": "Point", "coordinates": [round(place.longitude_deg, 8), round(place.latitude_deg, 8)]}
    features: list[tuple[dict[str, Any], dict[str, Any]]] = [(point, said)]
    ring = outline(place)
    if ring:
        ellipse = {"type": "Polygon", "coordinates": [[list(point) for point in ring]]}
        features.append((ellipse, _style(f"{place.name}: error ellipse, 95 %", f"#{color}", 0.1)))
    return features


def _shape(shape: Shape, color: str, fill: float) -> tuple[dict[str, Any], dict[str, Any]]:
    said = _style(clean(shape.name), color, fill)
    return shape.geometry, said | ({"description": clean(shape.why)} if shape.why else {})


def _style(title: str, color: str, fill: float) -> dict[str, Any]:
    stroke = {"stroke": color, "stroke-width": 2, "stroke-opacity": 1, "fill": color, "fill-opacity": fill}
    return {"class": "Shape", "title": title} | stroke


def _feature(identity: str, geometry: dict[str, Any] | None, said: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "id": identity, "geometry": geometry, "properties": said}


def _id(text: str) -> str:
    """The same name gives the same id, so that a second import replaces the first."""
    return hashlib.sha256(text.encode()).hexdigest()[:32]
