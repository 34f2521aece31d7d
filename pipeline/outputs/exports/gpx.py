"""GPX 1.1: way points for a handheld receiver, tracks of the drones."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from pipeline.outputs.exports.markup import add, xml_bytes
from pipeline.outputs.exports.view import RunView
from pipeline.outputs.exports.words import said_of
from pipeline.storage.whole_or_nothing import write_bytes

NAMESPACE = "http://www.topografix.com/GPX/1/1"


def write_gpx(folder: Path, view: RunView) -> list[str]:
    """Write ``places.gpx``. Without elevations: GPX means metres above the sea there, which the map need not know."""
    root = Element("gpx", {"version": "1.1", "creator": "Searchlight", "xmlns": NAMESPACE})
    head = add(root, "metadata")
    add(head, "name", view.mission)
    add(head, "desc", " ".join(part for part in (view.verdict, view.redacted) if part))
    for place in view.places:
        point = add(root, "wpt", lat=f"{place.latitude_deg:.8f}", lon=f"{place.longitude_deg:.8f}")
        add(point, "name", place.name)
        add(point, "cmt", place.mgrs)
        add(point, "desc", "\n".join(f"{label}: {text}" for label, text in said_of(place, view)))
        add(point, "sym", "Flag, Red" if place.kind == "found" else "Flag, Blue")
        add(point, "type", place.kind)
    for track in view.tracks:
        line = add(root, "trk")
        add(line, "name", track.name)
        segment = add(line, "trkseg")
        for longitude, latitude in _points(track.geometry):
            add(segment, "trkpt", lat=f"{latitude:.8f}", lon=f"{longitude:.8f}")
    write_bytes(folder / "places.gpx", xml_bytes(root))
    return ["places.gpx"]


def _points(line: dict[str, Any]) -> list[tuple[float, float]]:
    return [(float(point[0]), float(point[1])) for point in line["coordinates"]]
