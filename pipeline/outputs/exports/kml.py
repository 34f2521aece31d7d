"""KML 2.2 and KMZ: for Google Earth, ATAK, CalTopo and others; the KMZ has crops and the probability layer in it."""

from __future__ import annotations

import io
import zipfile
from html import escape
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from pipeline.outputs.exports.markup import add, xml_bytes
from pipeline.outputs.exports.overlay import Overlay, overlay_of
from pipeline.outputs.exports.view import Place, RunView, Shape
from pipeline.outputs.exports.words import COLORS, clean, outline, said_of
from pipeline.storage.whole_or_nothing import write_bytes

NAMESPACE = "http://www.opengis.net/kml/2.2"
#: ZIP's oldest date: the same run gives the same bytes
_DATE = (1980, 1, 1, 0, 0, 0)


def write_kml(folder: Path, view: RunView) -> list[str]:
    """Write ``places.kml``: places, error ellipses, ways and areas; without pictures."""
    write_bytes(folder / "places.kml", xml_bytes(_document(view, {}, {})))
    return ["places.kml"]


def write_kmz(folder: Path, view: RunView) -> list[str]:
    """Write ``places.kmz``: the same, with the pictures of the places and the probability layer over the ground."""
    files: dict[str, bytes] = {}
    names: dict[int, list[str]] = {}
    for place in view.places:
        for number, picture in enumerate(place.pictures, start=1):
            name = f"files/place-{place.id}-{number}.png"
            files[name] = picture.png
            names.setdefault(place.rank, []).append(name)
    overlays = {end: overlay_of(path, shifts) for end, (path, shifts) in view.layers.items()}
    files |= {f"files/probability{end}.png": overlay.png for end, overlay in overlays.items()}
    content = {"doc.kml": xml_bytes(_document(view, overlays, names))} | files
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in content.items():
            archive.writestr(zipfile.ZipInfo(name, _DATE), data, zipfile.ZIP_DEFLATED)
    write_bytes(folder / "places.kmz", buffer.getvalue())
    return ["places.kmz"]


def _document(view: RunView, overlays: dict[str, Overlay], pictures: dict[int, list[str]]) -> Element:
    """overlays: as ``RunView.layers``."""
    root = Element("kml", {"xmlns": NAMESPACE})
    document = add(root, "Document")
    add(document, "name", view.mission)
    add(document, "description", escape(" ".join(p for p in (view.verdict, view.redacted) if p)))
    for kind, color in COLORS.items():
        style = add(document, "Style", id=kind)
        icon = add(style, "IconStyle")
        add(icon, "color", _abgr(color))
        add(icon, "scale", "1.2" if kind == "found" else "0.9")
        _line_and_fill(style, color, 2, "40")
    for name, color, fill in (
        ("area", "0072B2", "00"),
        ("track", "56B4E9", "00"),
        ("second-look", "CC79A7", "50"),
    ):
        _line_and_fill(add(document, "Style", id=name), color, 3, fill)
    for end, overlay in overlays.items():
        _overlay(document, overlay, end)
    for title, places in (("Places", view.found), ("Possible places", view.possible)):
        if places:
            folder = add(document, "Folder")
            add(folder, "name", title)
            for place in places:
                _place(folder, place, view, pictures.get(place.rank, []))
    for title, style_of, shapes in (
        ("Search area", "area", view.areas),
        ("Drones' ways", "track", view.tracks),
        ("Worth a second look", "second-look", view.second_look),
    ):
        if shapes:
            folder = add(document, "Folder")
            add(folder, "name", title)
            for shape in shapes:
                _shape(folder, shape, style_of)
    return root


def _place(folder: Element, place: Place, view: RunView, pictures: list[str]) -> None:
    rows = "".join(
        f"<tr><td>{escape(label)}</td><td>{escape(text)}</td></tr>" for label, text in said_of(place, view)
    )
    shown = "".join(f'<img src="{name}" width="288"/>' for name in pictures)
    mark = add(folder, "Placemark", id=f"place-{place.id}")
    add(mark, "name", place.name)
    add(mark, "description", f"<table>{rows}</table>{shown}")
    add(mark, "styleUrl", f"#{place.kind}")
    add(add(mark, "Point"), "coordinates", f"{place.longitude_deg:.8f},{place.latitude_deg:.8f}")
    ring = outline(place)
    if ring:
        mark = add(folder, "Placemark", id=f"ellipse-{place.id}")
        add(mark, "name", f"{place.name}: error ellipse, 95 %")
        add(mark, "styleUrl", f"#{place.kind}")
        _ring(add(add(mark, "Polygon"), "outerBoundaryIs"), ring)


def _shape(folder: Element, shape: Shape, style: str) -> None:
    mark = add(folder, "Placemark")
    add(mark, "name", shape.name)
    if shape.why:
        add(mark, "description", escape(clean(shape.why)))
    add(mark, "styleUrl", f"#{style}")
    kind, coordinates = shape.geometry["type"], shape.geometry["coordinates"]
    if kind == "LineString":
        line = add(mark, "LineString")
        add(line, "tessellate", "1")
        add(line, "coordinates", _text(coordinates))
        return
    polygons = coordinates if kind == "MultiPolygon" else [coordinates]
    several = add(mark, "MultiGeometry")
    for outer, *holes in polygons:
        polygon = add(several, "Polygon")
        _ring(add(polygon, "outerBoundaryIs"), outer)
        for hole in holes:
            _ring(add(polygon, "innerBoundaryIs"), hole)


def _ring(parent: Element, points: Any) -> None:
    add(add(parent, "LinearRing"), "coordinates", _text(points))


def _text(points: Any) -> str:
    return " ".join(f"{float(point[0]):.8f},{float(point[1]):.8f}" for point in points)


def _line_and_fill(style: Element, color: str, width: int, fill: str) -> None:
    line = add(style, "LineStyle")
    add(line, "color", _abgr(color))
    add(line, "width", str(width))
    add(add(style, "PolyStyle"), "color", _abgr(color, fill))


def _abgr(rgb: str, alpha: str = "ff") -> str:
    """KML's order of a colour."""
    return f"{alpha}{rgb[4:6]}{rgb[2:4]}{rgb[0:2]}".lower()


def _overlay(document: Element, overlay: Overlay, end: str) -> None:
    """Of another class than the first it is there, and is not shown before somebody asks for it."""
    ground = add(document, "GroundOverlay")
    add(ground, "name", f"Probability{f', {clean(end[1:])}' if end else ''} (no colour: nobody looked)")
    if end:
        add(ground, "visibility", "0")
    add(add(ground, "Icon"), "href", f"files/probability{end}.png")
    box = add(ground, "LatLonBox")
    for side in ("north", "south", "east", "west"):
        add(box, side, f"{getattr(overlay, side):.8f}")
