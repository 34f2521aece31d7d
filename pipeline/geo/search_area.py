"""The ground that is to be searched, as a team draws it: GeoJSON (RFC 7946), KML or KMZ."""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import shapely

from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.messages import FloatArray

_EXPECTED = "GeoJSON, KML or KMZ with a Polygon or MultiPolygon in degrees"
_MOST_BYTES = 64 * 1024 * 1024
_WGS84 = ("CRS84", "EPSG::4326", "EPSG:4326", "EPSG::4979")
#: a file nests geometries no deeper
_DEEPEST = 20
#: polygons that share a border overlap by rounding
_SAME_SHARE = 1e-6
#: a line drawn to and fro encloses no more than this share of its length squared, by rounding
_LEAST_SHARE = 1e-9


@dataclass(frozen=True, eq=False)
class SearchArea:
    """Polygons of rings (N, 2), east and north, metres, not closed; the first ring is the outer one, then the holes.

    They neither overlap nor cross themselves. notes: what was mended for that, a sentence each.
    """

    polygons: tuple[tuple[FloatArray, ...], ...]
    notes: tuple[str, ...] = ()

    @property
    def area_m2(self) -> float:
        """The area of all polygons, holes left out."""
        return sum(_ring_m2(rings[0]) - sum(_ring_m2(hole) for hole in rings[1:]) for rings in self.polygons)

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """West, south, east and north edge."""
        points = np.concatenate([rings[0] for rings in self.polygons])
        (west, south), (east, north) = points.min(axis=0), points.max(axis=0)
        return float(west), float(south), float(east), float(north)


def load_search_area(path: Path, frame: LocalFrame) -> SearchArea:
    """The polygons of a file in the map frame; other geometries in it are left out. Raises InputError without one.

    What several polygons cover, or a ring that crosses itself encloses twice, is ground to search, and counts once.
    """
    data = _bytes(path)
    if path.suffix.lower() == ".gpx" or b"<gpx" in data[:4096]:
        found = "a GPX file: it holds tracks, routes and way points, and no areas"
        raise InputError(path, found, f"the area drawn as a polygon: {_EXPECTED}")
    polygons = list(
        _of_kml(path, data) if path.suffix.lower() in (".kml", ".kmz") else _of_geojson(path, data)
    )
    if not polygons:
        raise InputError(path, "no polygon", _EXPECTED)
    if not all(polygons):
        raise InputError(path, "a polygon without a ring", _EXPECTED)
    return _united(path, [[_ring(path, ring, frame) for ring in rings] for rings in polygons])


def load_weighted_areas(path: Path, frame: LocalFrame) -> tuple[tuple[SearchArea, float], ...]:
    """Polygons with a property ``weight``, 0 or more, of each feature of a GeoJSON file; areas may overlap.

    Raises InputError for another file, a feature without a weight, or one without a polygon.
    """
    expected = "GeoJSON features, each a polygon with a property `weight` of 0 or more"
    data = _bytes(path)
    _of_geojson(path, data)  # reads it, and refuses another CRS
    document = json.loads(data.decode("utf-8-sig"))
    features = document.get("features")
    if not isinstance(features, list) or not features:
        raise InputError(path, "no features", expected)
    areas = []
    for number, feature in enumerate(features):
        properties = feature.get("properties") if isinstance(feature, dict) else None
        weight = properties.get("weight") if isinstance(properties, dict) else None
        if isinstance(weight, bool) or not isinstance(weight, int | float) or not 0.0 <= weight < math.inf:
            raise InputError(f"{path} features.{number}.properties.weight", repr(weight)[:80], expected)
        polygons = list(_polygons(feature, 0))
        if not polygons or not all(polygons):
            raise InputError(f"{path} features.{number}", "no polygon", expected)
        rings = [[_ring(path, ring, frame) for ring in rings] for rings in polygons]
        areas.append((_united(path, rings), float(weight)))
    return tuple(areas)


def _united(path: Path, polygons: list[list[FloatArray]]) -> SearchArea:
    """The polygons made valid and one. Raises InputError if they enclose nothing."""
    drawn = [shapely.Polygon(rings[0], rings[1:]) for rings in polygons]
    valid = [
        p if p.is_valid else shapely.make_valid(p, method="structure", keep_collapsed=False) for p in drawn
    ]
    united = shapely.union_all(valid) if len(valid) > 1 else valid[0]
    parts = [
        part
        for part in shapely.get_parts(united)
        if isinstance(part, shapely.Polygon) and part.area > _LEAST_SHARE * part.length**2
    ]
    if not parts:
        raise InputError(path, "polygons that enclose no area", _EXPECTED)
    notes = []
    crossed = sum(not p.is_valid for p in drawn)
    if crossed:
        notes.append(
            f"{crossed} of {len(drawn)} polygons cross or touch themselves: all that their rings enclose is searched"
        )
    twice_m2 = sum(p.area for p in valid) - united.area
    if twice_m2 > _SAME_SHARE * united.area:
        notes.append(f"polygons overlap by {twice_m2:,.0f} m2, which counts once")
    rings = (tuple(_open(ring) for ring in (part.exterior, *part.interiors)) for part in parts)
    return SearchArea(tuple(rings), tuple(notes))


def _open(ring: shapely.LinearRing) -> FloatArray:
    return np.asarray(ring.coords, dtype=np.float64)[:-1, :2]


def _bytes(path: Path) -> bytes:
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(path, f"a file of {path.stat().st_size} bytes", _EXPECTED)
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(path, "no file", _EXPECTED) from None
    except OSError as error:
        raise InputError(path, f"a file that cannot be read ({error.strerror})", _EXPECTED) from None


def _of_geojson(path: Path, data: bytes) -> list[list[Any]]:
    try:
        document = json.loads(data.decode("utf-8-sig"))
        crs = document.get("crs")
        if crs is not None and not str(crs["properties"]["name"]).endswith(_WGS84):
            raise InputError(
                f"{path} crs", str(crs["properties"]["name"])[:80], "degrees of WGS84 (RFC 7946)"
            )
        return list(_polygons(document, 0))
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        raise InputError(path, f"text that cannot be read ({type(error).__name__})", _EXPECTED) from None


def _polygons(item: Any, depth: int) -> Iterator[list[Any]]:
    if item is None or depth > _DEEPEST:
        return
    kind = item.get("type")
    for key in ("features", "geometries"):
        for child in item.get(key) or ():
            yield from _polygons(child, depth + 1)
    if kind == "Feature":
        yield from _polygons(item.get("geometry"), depth + 1)
    elif kind == "Polygon":
        yield item["coordinates"]
    elif kind == "MultiPolygon":
        yield from item["coordinates"]


def _of_kml(path: Path, data: bytes) -> Iterator[list[list[list[float]]]]:
    try:
        if data[:2] == b"PK":
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                inside = next(i for i in archive.infolist() if i.filename.lower().endswith(".kml"))
                if inside.file_size > _MOST_BYTES:
                    raise InputError(path, f"{inside.file_size} bytes within it", _EXPECTED)
                data = archive.read(inside)
        if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
            raise InputError(path, "XML with a document type", _EXPECTED)
        root = ElementTree.fromstring(data)
        for polygon in root.iterfind(".//{*}Polygon"):
            rings = [*polygon.iterfind("{*}outerBoundaryIs"), *polygon.iterfind("{*}innerBoundaryIs")]
            texts = [c.text or "" for ring in rings for c in ring.iterfind(".//{*}coordinates")]
            yield [[[float(v) for v in point.split(",")] for point in text.split()] for text in texts]
    except (
        ElementTree.ParseError,
        zipfile.BadZipFile,
        StopIteration,
        ValueError,
        RuntimeError,
        OSError,
    ) as error:
        raise InputError(path, f"a file that cannot be read ({type(error).__name__})", _EXPECTED) from None


def _ring(path: Path, points: Any, frame: LocalFrame) -> FloatArray:
    try:
        degrees = np.array([[float(v) for v in point[:2]] for point in points], dtype=np.float64).reshape(
            -1, 2
        )
    except (TypeError, ValueError, LookupError):
        raise InputError(path, "a ring that is no ring of degrees", _EXPECTED) from None
    if len(degrees) > 1 and (degrees[0] == degrees[-1]).all():
        degrees = degrees[:-1]
    if len(degrees) < 3 or not np.isfinite(degrees).all() or np.any(np.abs(degrees) > (360.0, 90.0)):
        raise InputError(path, "a ring that is no ring of degrees", _EXPECTED)
    meters = np.stack(frame.enu_from_wgs84(degrees[:, 1], degrees[:, 0]), axis=1)
    if not np.isfinite(meters).all():
        raise InputError(path, "a ring a quarter of the earth away from the flight", _EXPECTED)
    return meters


def _ring_m2(ring: FloatArray) -> float:
    """The area inside a ring, by the shoelace formula."""
    x, y = ring[:, 0] - ring[0, 0], ring[:, 1] - ring[0, 1]
    return 0.5 * abs(math.fsum((x * np.roll(y, -1) - np.roll(x, -1) * y).tolist()))
