"""OGC GeoPackage for QGIS: a layer per kind of thing, each with its style.

Written with SQLite, which Python has: the format is a few tables (OGC 12-128r19), and the library that would write it
brings 100 MB of GDAL with it, beside the GDAL that rasterio has.
"""

from __future__ import annotations

import sqlite3
import struct
from contextlib import closing
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import shapely
from shapely.geometry import shape as shapely_shape

from pipeline.outputs.exports.gpkg_style import fill_style, line_style, point_style
from pipeline.outputs.exports.view import Place, RunView, Shape
from pipeline.outputs.exports.words import COLORS, clean, in_video, outline, what_to_do
from pipeline.storage.whole_or_nothing import replacing

#: "GPKG" as a number, and version 1.3 of the standard
_APPLICATION_ID, _USER_VERSION = 0x47504B47, 10300
_WGS84 = (
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],'
    'AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],UNIT["degree",0.0174532925199433,'
    'AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4326"]]'
)
_TABLES = """
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY, organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
  description TEXT DEFAULT '', last_change DATETIME NOT NULL, min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE,
  srs_id INTEGER, CONSTRAINT fk_gc_r_srs_id FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL,
  geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL,
  CONSTRAINT pk_geom_cols PRIMARY KEY (table_name, column_name), CONSTRAINT uk_gc_table_name UNIQUE (table_name),
  CONSTRAINT fk_gc_tn FOREIGN KEY (table_name) REFERENCES gpkg_contents(table_name),
  CONSTRAINT fk_gc_srs FOREIGN KEY (srs_id) REFERENCES gpkg_spatial_ref_sys (srs_id));
CREATE TABLE layer_styles (id INTEGER PRIMARY KEY AUTOINCREMENT, f_table_catalog TEXT, f_table_schema TEXT,
  f_table_name TEXT, f_geometry_column TEXT, styleName TEXT, styleQML TEXT, styleSLD TEXT, useAsDefault BOOLEAN,
  description TEXT, owner TEXT, ui TEXT, update_time DATETIME);
"""


@dataclass(frozen=True, eq=False)
class _Layer:
    """columns: name and SQLite's type. rows: a geometry and the columns' values."""

    name: str
    geometry: str
    columns: tuple[tuple[str, str], ...]
    rows: list[tuple[Any, ...]]
    style: str


def write_gpkg(folder: Path, view: RunView) -> list[str]:
    """Write ``places.gpkg``: layers places, possible_places, error_ellipses, search_area, tracks, second_look.

    A layer without features is there all the same: the next run's has the same names. WGS84, without heights in the
    geometries.
    """
    with (
        replacing(folder / "places.gpkg") as temporary,
        closing(sqlite3.connect(temporary)) as database,
        database,
    ):
        database.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
        database.execute(f"PRAGMA user_version = {_USER_VERSION}")
        database.executescript(_TABLES)
        _reference_systems(database)
        for layer in _layers(view):
            _write(database, layer, view)
    return ["places.gpkg"]


def _layers(view: RunView) -> list[_Layer]:
    ellipses = [(p, outline(p)) for p in view.places]
    return [
        _Layer("places", "POINT", _COLUMNS, [_place(p) for p in view.found], point_style(COLORS["found"])),
        _Layer(
            "possible_places",
            "POINT",
            _COLUMNS,
            [_place(p) for p in view.possible],
            point_style(COLORS["possible"]),
        ),
        _Layer(
            "error_ellipses",
            "POLYGON",
            (("name", "TEXT"), ("place", "INTEGER")),
            [(shapely.Polygon(ring), p.name, p.id) for p, ring in ellipses if ring],
            fill_style(COLORS["found"], 40),
        ),
        _shapes("search_area", "MULTIPOLYGON", view.areas, fill_style("0072B2", 0)),
        _shapes("tracks", "LINESTRING", view.tracks, line_style("56B4E9")),
        _shapes("second_look", "MULTIPOLYGON", view.second_look, fill_style("CC79A7", 80)),
    ]


_COLUMNS = (
    ("place", "INTEGER"),
    ("rank", "INTEGER"),
    ("name", "TEXT"),
    ("kind", "TEXT"),
    ("what_to_do", "TEXT"),
    ("class", "TEXT"),
    ("probability", "REAL"),
    ("expected_people", "REAL"),
    ("mgrs", "TEXT"),
    ("height_m", "REAL"),
    ("height_datum", "TEXT"),
    ("seen_from", "TEXT"),
    ("seen_to", "TEXT"),
    ("clock", "TEXT"),
    ("looks", "INTEGER"),
    ("sightings", "INTEGER"),
    ("streams", "TEXT"),
    ("in_video", "TEXT"),
)


def _place(p: Place) -> tuple[Any, ...]:
    said = (
        *(p.id, p.rank, p.name, p.kind, what_to_do(p), clean(p.class_name), p.probability, p.expected_people),
        *(p.mgrs, p.height_m, p.height_datum, p.first_seen, p.last_seen, p.clock, p.looks, p.sightings),
        clean("; ".join(p.streams)),
        clean("; ".join(where for where in map(in_video, p.pictures) if where)),
    )
    return (shapely.Point(p.longitude_deg, p.latitude_deg), *said)


def _shapes(name: str, geometry: str, shapes: tuple[Shape, ...], style: str) -> _Layer:
    rows = []
    for one in shapes:
        form = shapely_shape(one.geometry)
        if geometry == "MULTIPOLYGON" and isinstance(form, shapely.Polygon):
            form = shapely.MultiPolygon([form])
        rows.append((shapely.force_2d(form), clean(one.name), clean(one.why)))
    return _Layer(name, geometry, (("name", "TEXT"), ("why", "TEXT")), rows, style)


def _reference_systems(database: sqlite3.Connection) -> None:
    rows = [
        ("Undefined Cartesian", -1, "NONE", -1, "undefined", "undefined Cartesian coordinates"),
        ("Undefined geographic", 0, "NONE", 0, "undefined", "undefined geographic coordinates"),
        ("WGS 84 geodetic", 4326, "EPSG", 4326, _WGS84, "longitude and latitude"),
    ]
    database.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", rows)


def _write(database: sqlite3.Connection, layer: _Layer, view: RunView) -> None:
    columns = "".join(f', "{name}" {kind}' for name, kind in layer.columns)
    database.execute(
        f'CREATE TABLE "{layer.name}" (fid INTEGER PRIMARY KEY AUTOINCREMENT, geom {layer.geometry}{columns})'
    )
    names = ", ".join(f'"{name}"' for name, _ in layer.columns)
    marks = ", ".join("?" * (1 + len(layer.columns)))
    database.executemany(
        f'INSERT INTO "{layer.name}" (geom, {names}) VALUES ({marks})',
        [(_blob(geometry), *values) for geometry, *values in layer.rows],
    )
    bounds = shapely.total_bounds([row[0] for row in layer.rows]).tolist() if layer.rows else [None] * 4
    said = clean(" ".join(part for part in (view.mission, view.verdict, view.redacted) if part))
    at = _time(view.made_at)
    head = (layer.name, "features", layer.name, said, at, *bounds, 4326)
    database.execute("INSERT INTO gpkg_contents VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", head)
    database.execute(
        "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, 4326, 0, 0)", (layer.name, layer.geometry)
    )
    database.execute(
        "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, styleName, "
        "styleQML, styleSLD, useAsDefault, description, owner, ui, update_time) "
        "VALUES ('', '', ?, 'geom', 'Searchlight', ?, '', 1, '', '', NULL, ?)",
        (layer.name, layer.style, at),
    )


def _blob(geometry: shapely.Geometry) -> bytes:
    """GeoPackage's binary: magic, version 0, flags (little endian, envelope of xy for all but points), SRS, WKB."""
    envelope = b"" if isinstance(geometry, shapely.Point) else _envelope(geometry)
    flags = 0b00000001 | (0b00000010 if envelope else 0)
    return struct.pack("<2sBBi", b"GP", 0, flags, 4326) + envelope + shapely.to_wkb(geometry, byte_order=1)


def _envelope(geometry: shapely.Geometry) -> bytes:
    west, south, east, north = geometry.bounds
    return struct.pack("<4d", west, east, south, north)


def _time(at: datetime) -> str:
    return at.strftime("%Y-%m-%dT%H:%M:%S.") + f"{at.microsecond // 1000:03d}Z"
