"""Any other table, by the mission's map of its columns (``telemetry.columns``)."""

from __future__ import annotations

from pathlib import Path

from pipeline.config.telemetry import Telemetry
from pipeline.errors import InputError
from pipeline.ingest.tables.delimited import DelimitedTable, read_table
from pipeline.ingest.tables.known_names import columns_by_names
from pipeline.ingest.tables.track import track_of_table
from pipeline.ingest.tables.units import split_unit
from pipeline.ingest.text import decoded, read_text
from pipeline.ingest.track import Track

_SUFFIXES = (".csv", ".tsv", ".txt", ".tab", ".dat", ".log", ".asc")
#: what people call them, for the proposal; it is never used unasked
_USUAL_NAMES = {
    "time": ("time", "timestamp", "datetime", "date_time", "utc", "t", "gps_time", "time_utc", "zeit", "tid"),
    "latitude": ("latitude", "lat", "gps_lat", "gps_latitude", "breite", "breitengrad", "y"),
    "longitude": ("longitude", "lon", "lng", "long", "gps_lon", "gps_longitude", "länge", "längengrad", "x"),
    "absolute_height": (
        "altitude",
        "alt",
        "abs_alt",
        "gps_alt",
        "altitude_msl",
        "elevation",
        "height",
        "höhe",
        "z",
    ),
    "relative_height": ("rel_alt", "relative_altitude", "height_above_takeoff", "altitude_agl", "agl"),
    "yaw": ("gimbal_yaw", "gimbal_heading", "camera_yaw", "yaw", "heading", "azimuth", "kurs"),
    "pitch": ("gimbal_pitch", "camera_pitch", "pitch", "tilt", "nick"),
    "roll": ("gimbal_roll", "camera_roll", "roll", "roll_angle"),
}
_USUAL_UNITS = {"absolute_height": "meters", "relative_height": "meters", "time": "seconds"}
_NEEDED = ("time", "latitude", "longitude", "absolute_height", "yaw", "pitch", "roll")


def is_table(path: Path, head: bytes) -> bool:
    """Whether a file looks like a table of any kind: text, in lines of three cells or more."""
    if path.suffix.lower() not in _SUFFIXES:
        return False
    lines = [line for line in decoded(head).split("\n")[:20] if line.strip()]
    return sum(sum(line.count(c) for c in ",;\t|") >= 2 for line in lines) >= 2


def read_column_table(telemetry: Telemetry) -> Track:
    """The samples of a table. Raises InputError if its columns are not stated: with a proposal to fill in."""
    text = read_text(telemetry.file, "a table of telemetry")
    table = read_table(telemetry.file, text, telemetry.table)
    if not telemetry.columns:
        found = f"a table of unknown columns ({', '.join(table.names[:20])})"
        raise InputError(
            telemetry.file, found, f"in the stream's telemetry, checked and filled in: {proposal(table)}"
        )
    return track_of_table(table, dict(telemetry.columns))


def proposal(table: DelimitedTable) -> str:
    """A ``columns:`` section in one line, as far as the head allows; ? for what it does not tell."""
    found = columns_by_names(table, _USUAL_NAMES)
    wanted = [
        q
        for q in _USUAL_NAMES
        if q in found or (q in _NEEDED and (q != "absolute_height" or "relative_height" not in found))
    ]
    return "columns: {" + ", ".join(_entry(q, found[q].name if q in found else "?") for q in wanted) + "}"


def _entry(quantity: str, name: str | int) -> str:
    unit = split_unit(str(name))[1] or _USUAL_UNITS.get(quantity, "degrees")
    zone = ", zone: utc" if quantity == "time" else ""
    return f"{quantity}: {{name: '{name}', unit: {unit}{zone}}}"
