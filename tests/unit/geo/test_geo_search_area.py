"""A search area is the polygons that a team drew, in whichever of their tools, and nothing else."""

import json
import math
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.search_area import load_search_area
from pipeline.geo.terrain import Terrain
from pipeline.second_look.cells import cells_inside

FRAME = LocalFrame(47.0, 8.0)
SHARED = Path(__file__).parents[4] / "shared/data/cases/area"


def ring(half_m: float, east: float = 0.0, frame: LocalFrame = FRAME) -> list[list[float]]:
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * half_m + (east, 0.0)
    latitude, longitude = frame.wgs84_from_enu(corners[:, 0], corners[:, 1])
    return np.stack([longitude, latitude], axis=1).tolist()  # type: ignore[no-any-return]


def write(path: Path, document: Any, encoding: str = "utf-8") -> Path:
    path.write_text(document if isinstance(document, str) else json.dumps(document), encoding=encoding)
    return path


POLYGON = {"type": "Polygon", "coordinates": [ring(10.0)]}
HOLE = {"type": "Polygon", "coordinates": [ring(10.0), ring(4.0)]}
TWO = {"type": "MultiPolygon", "coordinates": [[ring(10.0)], [ring(5.0, 50.0)]]}
POINT = {"type": "Point", "coordinates": [8.0, 47.0]}


@pytest.mark.parametrize(
    ("document", "area_m2"),
    [
        (POLYGON, 400.0),
        (HOLE, 336.0),
        (TWO, 500.0),
        ({"type": "Feature", "geometry": HOLE, "properties": {}}, 336.0),
        ({"type": "FeatureCollection", "features": [{"geometry": g, "type": "Feature"} for g in (POINT, TWO)]}, 500.0),
        ({"type": "GeometryCollection", "geometries": [POINT, POLYGON]}, 400.0),
        (POLYGON | {"crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}}, 400.0),
        ({"type": "Polygon", "coordinates": [ring(10.0)[:-1]]}, 400.0),
        ({"type": "Polygon", "coordinates": [[[*p, 500.0] for p in ring(10.0)]]}, 400.0),
    ],
)  # fmt: skip
def test_the_area_of_every_form_of_geojson(tmp_path: Path, document: Any, area_m2: float) -> None:
    assert load_search_area(write(tmp_path / "a.geojson", document), FRAME).area_m2 == pytest.approx(
        area_m2, rel=1e-6
    )


def square(half_m: float, east: float = 0.0, north: float = 0.0) -> list[tuple[float, float]]:
    return [
        (east + x * half_m, north + y * half_m) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
    ]


def degrees(ring_m: list[tuple[float, float]], frame: LocalFrame = FRAME) -> list[list[float]]:
    points = np.array(ring_m)
    latitude, longitude = frame.wgs84_from_enu(points[:, 0], points[:, 1])
    return np.stack([longitude, latitude], axis=1).tolist()  # type: ignore[no-any-return]


def document(*polygons: list[list[tuple[float, float]]], frame: LocalFrame = FRAME) -> dict[str, Any]:
    return {
        "type": "MultiPolygon",
        "coordinates": [[degrees(ring, frame) for ring in rings] for rings in polygons],
    }


STAR = [(10.0 * math.sin(k * 0.8 * math.pi), 10.0 * math.cos(k * 0.8 * math.pi)) for k in (0, 1, 2, 3, 4, 0)]
#: of a five-pointed star in a circle of 10 m, its middle too
STAR_M2 = 112.257
CROSSED = {
    "two that overlap": (document([square(10.0)], [square(10.0, 10.0)]), 600.0, "overlap by 200 m2"),
    "the same one twice": (document([square(10.0)], [square(10.0)]), 400.0, "overlap by 400 m2"),
    "three in one place": (document([square(10.0)], [square(5.0)], [square(2.0)]), 400.0, "overlap by 1"),
    "a hole that another one fills": (document([square(10.0), square(4.0)], [square(4.0)]), 400.0, ""),
    "neighbours with a common side": (document([square(10.0)], [square(10.0, 20.0)]), 800.0, ""),
    "a bow tie": (document([[(-10, -10), (10, 10), (10, -10), (-10, 10), (-10, -10)]]), 200.0, "cross or touch"),
    "a star drawn in one line": (document([STAR]), STAR_M2, "cross or touch"),
    "a ring that goes around twice": (document([square(10.0)[:-1] + square(15.0)]), 900.0, "cross or touch"),
    "a hole that sticks out": (document([square(10.0), square(5.0, 10.0)]), 350.0, "cross or touch"),
    "a hole beside it": (document([square(10.0), square(5.0, 40.0)]), 500.0, "cross or touch"),
}  # fmt: skip


@pytest.mark.parametrize("name", CROSSED)
def test_what_is_drawn_twice_counts_once_and_what_a_crossing_ring_encloses_is_searched(
    tmp_path: Path, name: str
) -> None:
    drawn, area_m2, note = CROSSED[name]
    path = write(tmp_path / "a.geojson", drawn)
    area = load_search_area(path, FRAME)
    assert area.area_m2 == pytest.approx(area_m2, rel=1e-4)
    assert len(area.notes) == (1 if note else 0)
    assert note in " ".join(area.notes)
    terrain = Terrain(FRAME, -60.0, -60.0, 0.5, np.zeros((240, 240), np.float32))
    assert cells_inside(area, terrain).sum() * 0.25 == pytest.approx(area_m2, rel=0.04)


@pytest.mark.parametrize(
    "frame",
    [
        LocalFrame(-54.8, -68.3),
        LocalFrame(78.9, 11.9),
        LocalFrame(-78.0, 167.0),
        LocalFrame(84.9, 179.9999),
        LocalFrame(0.0, -180.0),
    ],
)
def test_an_area_is_as_large_in_the_south_near_the_poles_and_on_the_antimeridian(
    tmp_path: Path, frame: LocalFrame
) -> None:
    area = load_search_area(write(tmp_path / "a.geojson", document([square(100.0)], frame=frame)), frame)
    assert area.area_m2 == pytest.approx(40_000.0, rel=1e-6)
    assert area.bounds_m == pytest.approx((-100.0, -100.0, 100.0, 100.0), abs=1e-3)


GPX = (
    '<?xml version="1.0"?><gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'
    '<trkpt lat="47.0" lon="8.0"/><trkpt lat="47.1" lon="8.0"/></trkseg></trk></gpx>'
)


@pytest.mark.parametrize("name", ["sector.gpx", "SECTOR.GPX", "sector.kml", "sector.xml", "sector.json"])
def test_a_gpx_file_is_refused_for_what_it_is(tmp_path: Path, name: str) -> None:
    with pytest.raises(
        InputError, match=r"a GPX file: it holds tracks.*expected the area drawn as a polygon"
    ):
        load_search_area(write(tmp_path / name, GPX), FRAME)


@pytest.mark.parametrize("ring_m", [[(0, 0), (10, 10), (20, 20), (0, 0)], [(0, 0), (5, 0), (5, 0), (0, 0)]])
def test_a_polygon_that_encloses_nothing_is_refused(
    tmp_path: Path, ring_m: list[tuple[float, float]]
) -> None:
    with pytest.raises(InputError, match="enclose no area"):
        load_search_area(write(tmp_path / "a.geojson", document([ring_m])), FRAME)


def test_a_byte_order_mark_does_not_matter(tmp_path: Path) -> None:
    assert load_search_area(
        write(tmp_path / "a.geojson", POLYGON, "utf-8-sig"), FRAME
    ).area_m2 == pytest.approx(400.0)


def kml(outer: list[list[float]], inner: list[list[float]]) -> str:
    def text(points: list[list[float]]) -> str:
        return "\n".join(f"{x!r},{y!r},12" for x, y in points)

    return (
        '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>sector</name><Polygon>'
        f"<outerBoundaryIs><LinearRing><coordinates>{text(outer)}</coordinates></LinearRing></outerBoundaryIs>"
        f"<innerBoundaryIs><LinearRing><coordinates>{text(inner)}</coordinates></LinearRing></innerBoundaryIs>"
        "</Polygon></Placemark></Document></kml>"
    )


def test_kml_and_kmz_are_read(tmp_path: Path) -> None:
    text = kml(ring(10.0), ring(4.0))
    with zipfile.ZipFile(tmp_path / "a.kmz", "w") as archive:
        archive.writestr("doc.kml", text)
    for path in (write(tmp_path / "a.kml", text), tmp_path / "a.kmz"):
        assert load_search_area(path, FRAME).area_m2 == pytest.approx(336.0, rel=1e-6)


def test_the_antimeridian_runs_through_an_area(tmp_path: Path) -> None:
    frame = LocalFrame(-17.0, 180.0)
    document = {"type": "Polygon", "coordinates": [ring(10.0, frame=frame)]}
    assert load_search_area(write(tmp_path / "a.geojson", document), frame).area_m2 == pytest.approx(
        400.0, rel=1e-6
    )


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("{", "text that cannot be read"),
        ("[]", "text that cannot be read"),
        ("3", "text that cannot be read"),
        ('{"type": "FeatureCollection", "features": []}', "no polygon"),
        ('{"type": "Point", "coordinates": [8, 47]}', "no polygon"),
        ('{"type": "Polygon", "coordinates": [[[500, 0], [1, 1], [2, 2], [500, 0]]]}', "a ring"),
        ('{"type": "Polygon", "coordinates": []}', "a polygon without a ring"),
        ('{"type": "Polygon", "coordinates": [[[1, 0]]]}', "a ring"),
        ('{"type": "Polygon", "coordinates": [[["x", 0], [1, 1], [2, 2]]]}', "a ring"),
        (json.dumps(POLYGON | {"crs": {"properties": {"name": "EPSG:32632"}}}), "crs: found EPSG:32632"),
    ],
)
def test_a_file_that_is_no_polygon_is_refused(tmp_path: Path, text: str, found: str) -> None:
    with pytest.raises(InputError, match=found):
        load_search_area(write(tmp_path / "a.geojson", text), FRAME)


@pytest.mark.parametrize(
    "text", ["<kml", '<!DOCTYPE x [<!ENTITY a "b">]><kml>&a;</kml>', "<kml></kml>", "PK\x03\x04"]
)
def test_kml_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError):
        load_search_area(write(tmp_path / "a.kml", text), FRAME)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no file"):
        load_search_area(tmp_path / "none.geojson", FRAME)


@pytest.mark.parametrize(
    ("name", "area_m2"),
    [("area", 3600.0), ("area_hole", 3276.0), ("area_bom", 3600.0), ("area_beyond", 16_000.0)],
)
def test_the_area_of_a_shared_file(name: str, area_m2: float) -> None:
    if not SHARED.exists():
        pytest.skip("no shared data beside the repository")
    frame = LocalFrame(58.4021, 15.5751)
    assert load_search_area(SHARED / f"{name}.geojson", frame).area_m2 == pytest.approx(area_m2, rel=0.004)
