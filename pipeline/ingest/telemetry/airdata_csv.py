"""Flight logs as Airdata writes them (airdata.com, "CSV"): a row each 100 ms.

Heights, distances and speeds are in the units that the user chose there, which the head says. Dates are in
whole seconds of UTC; milliseconds of flight stand beside them. Heights above sea level are those of a
terrain model plus the height above take-off.
"""

from __future__ import annotations

from pathlib import Path

from pipeline.config.telemetry import Telemetry
from pipeline.ingest.tables.delimited import read_table
from pipeline.ingest.tables.known_names import columns_by_names, head_names
from pipeline.ingest.tables.track import track_of_table
from pipeline.ingest.text import read_text
from pipeline.ingest.track import Track

_NAMES = {
    "time": ("datetime(utc)", "datetime"),
    "elapsed": ("time(millisecond)",),
    "latitude": ("latitude",),
    "longitude": ("longitude",),
    "relative_height": ("height_above_takeoff", "altitude"),
    "absolute_height": ("altitude_above_seaLevel",),
    "yaw": ("gimbal_heading", "gimbal_yaw"),
    "pitch": ("gimbal_pitch",),
    "roll": ("gimbal_roll",),
    "aircraft_yaw": ("compass_heading",),
    "aircraft_pitch": ("pitch",),
    "aircraft_roll": ("roll",),
    "satellites": ("satellites", "gps"),
    "gps_level": ("gpslevel",),
    "recording": ("isVideo",),
}


#: one of these stands in every selection of columns that users export
_OWN = {
    "heightabovetakeoff",
    "altitudeabovesealevel",
    "compassheading",
    "gimbalheading",
    "gimbalpitch",
    "ascent",
}


def is_airdata_csv(path: Path, head: bytes) -> bool:
    """Whether a file's head is Airdata's."""
    names = head_names(head)
    return {"time", "datetime", "latitude", "longitude"} <= names and bool(_OWN & names)


def read_airdata_csv(telemetry: Telemetry) -> Track:
    """The samples of a file. Raises InputError if none can be used."""
    text = read_text(telemetry.file, "a flight log of Airdata (CSV)")
    table = read_table(telemetry.file, text, telemetry.table, free_text="message")
    return track_of_table(table, columns_by_names(table, _NAMES) | telemetry.columns, height_datum="geoid")
