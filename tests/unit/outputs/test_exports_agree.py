"""Every format says the same of every place, read back by a library that did not write it."""

from __future__ import annotations

import csv
import io
import json
import sqlite3
import zipfile
from datetime import UTC, datetime
from pathlib import Path
from typing import get_args

import fastkml
import fastkml.validator
import gpxpy
import numpy as np
import pyogrio
import pypdf
import pytak
import pytest
import rasterio
import shapely
from geojson_pydantic import FeatureCollection
from lxml import etree
from PIL import Image
from rio_cogeo import cog_info, cog_validate
from run_folder import write_run

from pipeline.config.outputs import ExportFormat
from pipeline.geo.frame import LocalFrame
from pipeline.outputs.exports.registry import FORMATS, write_exports
from pipeline.outputs.exports.view import RunView, read_run

AT = datetime(2026, 5, 1, 12, 0, 0, 250_000, tzinfo=UTC)
KML = {"k": "http://www.opengis.net/kml/2.2"}
EXACT = 1e-7


@pytest.fixture(scope="module")
def handed_over(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunView, Path]:
    folder = tmp_path_factory.mktemp("run")
    view = read_run(write_run(folder / "run"), AT)
    names = write_exports(folder / "out", view, list(FORMATS))
    assert sorted(names) == sorted(
        p.relative_to(folder / "out").as_posix() for p in (folder / "out").rglob("*") if p.is_file()
    )
    return view, folder / "out"


def positions(view: RunView, kind: str | None = None) -> list[tuple[float, float]]:
    return [(p.longitude_deg, p.latitude_deg) for p in view.places if kind in (None, p.kind)]


def test_the_mission_file_names_every_format() -> None:
    assert list(get_args(ExportFormat)) == list(FORMATS)


def test_places_come_in_the_order_in_which_they_are_looked_at(handed_over: tuple[RunView, Path]) -> None:
    view, _ = handed_over
    assert [(p.rank, p.id, p.kind) for p in view.places] == [
        (1, 2, "found"),
        (2, 3, "found"),
        (3, 1, "found"),
        (4, 5, "possible"),
        (5, 4, "possible"),
    ]


def test_geojson_is_valid_and_exact(handed_over: tuple[RunView, Path]) -> None:
    view, out = handed_over
    text = (out / "places.geojson").read_text()
    document = FeatureCollection.model_validate_json(text)
    points = [f for f in document.features if f.geometry is not None and f.geometry.type == "Point"]
    assert [f.properties["name"] for f in points if f.properties] == [p.name for p in view.places]
    read = [tuple(f.geometry.coordinates)[:2] for f in points if f.geometry]
    np.testing.assert_allclose(read, positions(view), atol=EXACT, rtol=0)
    # Trondheim's geoid is some 40 m above the ellipsoid: the height is not the map's
    heights = [f.geometry.coordinates[2] for f in points if f.geometry]
    assert [h - 121.0 for h in heights] == pytest.approx([40.0] * 5, abs=2.0)
    areas = [f for f in json.loads(text)["features"] if f["properties"]["kind"] == "search area"]
    outer, hole = areas[0]["geometry"]["coordinates"]
    assert shapely.LinearRing(outer).is_ccw
    assert not shapely.LinearRing(hole).is_ccw


def test_kml_is_valid_by_the_schema_of_the_ogc(handed_over: tuple[RunView, Path]) -> None:
    view, out = handed_over
    assert fastkml.validator.validate(file_to_validate=out / "places.kml")
    document = fastkml.KML.parse(out / "places.kml")
    read = {
        mark.name: (mark.geometry.x, mark.geometry.y)
        for mark in fastkml.utils.find_all(document, of_type=fastkml.Placemark)
        if mark.geometry is not None and mark.geometry.geom_type == "Point"
    }
    assert list(read) == [p.name for p in view.places]
    np.testing.assert_allclose(list(read.values()), positions(view), atol=EXACT, rtol=0)


def test_an_ellipse_is_where_it_should_be(handed_over: tuple[RunView, Path]) -> None:
    """Its ring lies at the half axes from the place, turned as it says; measured in the map frame about the place."""
    view, out = handed_over
    root = etree.parse(out / "places.kml")
    for place in view.places:
        assert place.error is not None
        path = f"//k:Placemark[@id='ellipse-{place.id}']//k:coordinates/text()"
        text = root.xpath(path, namespaces=KML)[0]
        ring = np.array([[float(v) for v in point.split(",")] for point in text.split()])
        assert shapely.LinearRing(ring).is_ccw
        frame = LocalFrame(place.latitude_deg, place.longitude_deg)
        east, north = frame.enu_from_wgs84(ring[:, 1], ring[:, 0])
        meters = np.hypot(east, north)
        assert max(meters) == pytest.approx(place.error.semi_major_m, abs=0.01)
        assert min(meters) == pytest.approx(place.error.semi_minor_m, abs=0.01)
        farthest = int(np.argmax(meters))
        longest = np.degrees(np.arctan2(east[farthest], north[farthest])) % 180.0
        assert longest == pytest.approx(place.error.orientation_deg, abs=4.0)


def test_kmz_carries_its_pictures_and_the_map(handed_over: tuple[RunView, Path]) -> None:
    view, out = handed_over
    with zipfile.ZipFile(out / "places.kmz") as archive:
        assert archive.testzip() is None
        assert archive.namelist()[0] == "doc.kml"
        root = etree.fromstring(archive.read("doc.kml"))
        names = set(archive.namelist())
        text = "".join(root.itertext())
        shown = {name for name in names if name.startswith("files/place-")}
        assert shown == {"files/place-1-1.png", "files/place-2-1.png", "files/place-4-1.png"}
        assert all(name in text for name in names - {"doc.kml"})
        overlay = Image.open(io.BytesIO(archive.read("files/probability.png")))
    schema = Path(fastkml.validator.__file__).parent / "schema" / "ogckml22.xsd"
    etree.XMLSchema(etree.parse(schema)).assertValid(root)
    box = {
        side: float(root.xpath(f"//k:LatLonBox/k:{side}/text()", namespaces=KML)[0])
        for side in ("west", "south", "east", "north")
    }
    # where the overlay says that it is brightest, there are the places: read by pixel, not by our code
    pixels = np.asarray(overlay)
    for place in view.found:
        column = int((place.longitude_deg - box["west"]) / (box["east"] - box["west"]) * pixels.shape[1])
        row = int((box["north"] - place.latitude_deg) / (box["north"] - box["south"]) * pixels.shape[0])
        assert pixels[row - 1 : row + 2, column - 1 : column + 2, 3].max() > 230
    assert pixels[..., 3].min() == 0  # where nobody looked, nothing is drawn


def test_gpx_is_read_by_gpxpy(handed_over: tuple[RunView, Path]) -> None:
    view, out = handed_over
    document = gpxpy.parse((out / "places.gpx").read_text())
    assert [w.name for w in document.waypoints] == [p.name for p in view.places]
    read = [(w.longitude, w.latitude) for w in document.waypoints]
    np.testing.assert_allclose(read, positions(view), atol=EXACT, rtol=0)
    assert [t.name for t in document.tracks] == ["drone-1", "drone-2"]
    track = [[p.longitude, p.latitude] for p in document.tracks[0].segments[0].points]
    np.testing.assert_allclose(track, view.tracks[0].geometry["coordinates"], atol=EXACT, rtol=0)
    assert all(w.elevation is None for w in document.waypoints)


def test_csv_has_every_column_with_its_unit_and_none_empty(handed_over: tuple[RunView, Path]) -> None:
    view, out = handed_over
    with (out / "places.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    read = [(float(r["longitude_wgs84_deg"]), float(r["latitude_wgs84_deg"])) for r in rows]
    np.testing.assert_allclose(read, positions(view), atol=EXACT, rtol=0)
    assert [int(r["id"]) for r in rows] == [p.id for p in view.places]
    assert all(any(row[name] for row in rows) for name in rows[0])
    assert {"utm_easting_m", "height_above_wgs84_ellipsoid_m", "error_95_semi_major_m"} <= set(rows[0])
    assert "redacted" not in rows[0]
    assert rows[0]["in_video"] == "drone-1, DJI_0001.MP4 at 01:07.4, frame 1964"


def test_cog_is_one_and_holds_the_same_map(handed_over: tuple[RunView, Path]) -> None:
    view, out = handed_over
    valid, errors, warnings = cog_validate(out / "saliency.cog.tif", strict=True)
    assert (valid, errors, warnings) == (True, [], [])
    assert cog_info(out / "saliency.cog.tif").COG
    assert view.saliency is not None
    with rasterio.open(view.saliency) as old, rasterio.open(out / "saliency.cog.tif") as new:
        np.testing.assert_array_equal(old.read(), new.read())
        assert (old.descriptions, old.units, old.transform) == (new.descriptions, new.units, new.transform)
        assert old.crs == new.crs


def test_geopackage_is_opened_by_gdal(handed_over: tuple[RunView, Path]) -> None:
    view, out = handed_over
    path = out / "places.gpkg"
    layers = {str(name): str(kind) for name, kind in pyogrio.list_layers(path) if kind}
    assert layers == {
        "places": "Point",
        "possible_places": "Point",
        "error_ellipses": "Polygon",
        "search_area": "MultiPolygon",
        "tracks": "LineString",
        "second_look": "MultiPolygon",
    }
    for layer, kind in (("places", "found"), ("possible_places", "possible")):
        meta, _, geometry, fields = pyogrio.raw.read(path, layer=layer)
        assert meta["crs"] == "EPSG:4326"
        read = [(p.x, p.y) for p in shapely.from_wkb(geometry)]
        np.testing.assert_allclose(read, positions(view, kind), atol=EXACT, rtol=0)
        values = dict(zip(meta["fields"], fields, strict=True))
        assert list(values["mgrs"]) == [p.mgrs for p in view.places if p.kind == kind]
    _, _, areas, _ = pyogrio.raw.read(path, layer="second_look")
    assert [len(shapely.get_parts(a)) for a in shapely.from_wkb(areas)] == [1, 1]
    with sqlite3.connect(path) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert database.execute("PRAGMA foreign_key_check").fetchall() == []
        styles = database.execute("SELECT f_table_name, styleQML FROM layer_styles").fetchall()
    assert {name for name, _ in styles} == set(layers)
    for _, style in styles:
        assert etree.fromstring(style.split(">", 1)[1]).tag == "qgis"


def test_caltopo_takes_markers_in_folders(handed_over: tuple[RunView, Path]) -> None:
    view, out = handed_over
    features = json.loads((out / "caltopo.json").read_text())["features"]
    folders = {f["id"]: f["properties"]["title"] for f in features if f["properties"]["class"] == "Folder"}
    assert len(folders) == 5
    rest = [f for f in features if f["properties"]["class"] != "Folder"]
    assert all(f["properties"]["folderId"] in folders for f in rest)
    assert len({f["id"] for f in features}) == len(features)
    markers = [f for f in rest if f["properties"]["class"] == "Marker"]
    assert [m["properties"]["title"] for m in markers] == [p.name for p in view.places]
    assert all({"marker-symbol", "marker-color"} <= set(m["properties"]) for m in markers)
    read = [m["geometry"]["coordinates"] for m in markers]
    np.testing.assert_allclose(read, positions(view), atol=EXACT, rtol=0)
    FeatureCollection.model_validate({"type": "FeatureCollection", "features": rest})


def test_cot_is_read_by_two_parsers(handed_over: tuple[RunView, Path]) -> None:
    """PyTAK builds an event of its own from what lxml reads of ours: the two points are the same."""
    view, out = handed_over
    for place in view.places:
        data = (out / f"cot/place-{place.id}.cot").read_bytes()
        event = etree.fromstring(data)
        point = event.find("point")
        assert (float(point.get("lon")), float(point.get("lat"))) == pytest.approx(
            (place.longitude_deg, place.latitude_deg), abs=EXACT
        )
        assert place.error is not None
        # one sigma of the long axis: the 95 % ellipse's over 2.4477
        assert float(point.get("ce")) == pytest.approx(place.error.semi_major_m / 2.447746831, abs=1e-3)
        assert point.get("le") == "9999999.0"
        assert float(point.get("hae")) == pytest.approx(place.ellipsoidal_m, abs=1e-3)
        assert (event.get("time"), event.get("stale")) == (
            "2026-05-01T12:00:00.250Z",
            "2026-05-02T12:00:00.250Z",
        )
        # gen_cot cuts positions to 4 decimals, 11 m; its point does not have to
        theirs = pytak.functions.cot_point(
            *(float(point.get(k)) for k in ("lat", "lon", "ce", "hae", "le")), precision=8
        )
        for name, within in (("lat", EXACT), ("lon", EXACT), ("hae", 1e-3), ("ce", 1e-3), ("le", 0.0)):
            assert float(theirs.get(name, "nan")) == pytest.approx(float(point.get(name)), abs=within)
    uids = {etree.parse(path).getroot().get("uid") for path in (out / "cot").iterdir()}
    assert len(uids) == len(view.places)


def test_pdf_says_verdict_and_every_place(handed_over: tuple[RunView, Path]) -> None:
    view, out = handed_over
    pages = pypdf.PdfReader(out / "report.pdf").pages
    text = " ".join(" ".join(page.extract_text() for page in pages).split())
    assert view.verdict in text
    for place in view.places:
        assert place.mgrs in text
        assert f"{place.latitude_deg:.7f}, {place.longitude_deg:.7f}" in text
    assert text.index(view.found[0].mgrs) < text.index(view.found[1].mgrs) < text.index(view.possible[0].mgrs)
    # three crops and the map
    assert sum(len(page.images) for page in pages) == 4


def test_the_same_run_gives_the_same_bytes(handed_over: tuple[RunView, Path], tmp_path: Path) -> None:
    view, out = handed_over
    write_exports(tmp_path, view, list(FORMATS))
    for path in sorted(p for p in out.rglob("*") if p.is_file() and p.suffix not in (".gpkg",)):
        assert (tmp_path / path.relative_to(out)).read_bytes() == path.read_bytes(), path.name


@pytest.mark.parametrize("datum", ["ellipsoid", None])
def test_a_height_is_above_the_ellipsoid_or_left_out(tmp_path: Path, datum: str | None) -> None:
    view = read_run(write_run(tmp_path / "run", datum=datum), AT)
    write_exports(tmp_path / "out", view, ["geojson", "cot", "csv"])
    event = etree.parse(tmp_path / "out/cot/place-1.cot").find("point")
    place = json.loads((tmp_path / "out/places.geojson").read_text())["features"][0]
    if datum is None:
        assert event.get("hae") == "9999999.0"
        assert len(place["geometry"]["coordinates"]) == 2
        assert (
            "height_above_wgs84_ellipsoid_m" not in (tmp_path / "out/places.csv").read_text().split("\r\n")[0]
        )
    else:
        assert float(event.get("hae")) == 121.0
        assert place["geometry"]["coordinates"][2] == 121.0
    assert place["properties"]["height_datum"] == (datum or "not known")


@pytest.mark.parametrize(
    ("zone", "clock", "said"),
    [
        (None, "UTC", "2026-05-01 10:00:06 UTC to 2026-05-01 10:00:10 UTC"),
        ("Europe/Oslo", "UTC", "2026-05-01 12:00:06 CEST to 2026-05-01 12:00:10 CEST"),
        ("Europe/Oslo", "local time", "2026-05-01 10:00:06 local time to 2026-05-01 10:00:10 local time"),
    ],
)
def test_people_read_times_in_the_zone_of_the_mission(
    tmp_path: Path, zone: str | None, clock: str, said: str
) -> None:
    folder = write_run(tmp_path / "run")
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["time_zone"] is None
    (folder / "summary.json").write_text(json.dumps(summary | {"time_zone": zone}))
    document = json.loads((folder / "salient.geojson").read_text())
    for feature in document["features"]:
        feature["properties"]["clock"] = clock
    (folder / "salient.geojson").write_text(json.dumps(document))
    write_exports(tmp_path / "out", read_run(folder, AT), ["gpx", "pdf", "csv"])
    assert f"Seen: {said}" in (tmp_path / "out/places.gpx").read_text()
    pages = pypdf.PdfReader(tmp_path / "out/report.pdf").pages
    text = " ".join(" ".join(page.extract_text() for page in pages).split())
    assert f"Seen: {said}" in text
    assert "2026-05-01T10:00:06.000Z" in (tmp_path / "out/places.csv").read_text()
