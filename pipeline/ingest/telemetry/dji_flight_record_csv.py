"""DJI's own flight records, decoded to CSV: by PhantomHelp and Flight Reader, TXTlogToCSVtool, dji-log-parser.

All name their columns after the record's fields (``OSD.latitude``, ``GIMBAL.pitch``). The first two write
``sep=,`` above the head, units in brackets, and the date apart from the time, which has half days (AM, PM)
and the zone in brackets. ``OSD.flyTime`` stands still while the motors do. ``OSD.altitude`` is called above sea
level, but the drones differ in what they take for it: its datum is left open.
"""

from __future__ import annotations

from pathlib import Path

from pipeline.config.telemetry import Column, Telemetry
from pipeline.ingest.tables.delimited import DelimitedTable, read_table
from pipeline.ingest.tables.known_names import columns_by_names, head_names
from pipeline.ingest.tables.track import track_of_table
from pipeline.ingest.text import read_text
from pipeline.ingest.track import Track

_NAMES = {
    "time": (
        *("CUSTOM.updateTime [UTC]", "CUSTOM.dateTime [UTC]", "CUSTOM.dateTime", "CUSTOM.updateTime [local]"),
        *("CUSTOM.updateTime", "DETAILS.updateTime", "timestamps", "timestamp"),
    ),
    "latitude": ("OSD.latitude",),
    "longitude": ("OSD.longitude",),
    "relative_height": ("OSD.height",),
    "absolute_height": ("OSD.altitude",),
    "yaw": ("GIMBAL.yaw", "GIMBAL.yaw [360]"),
    "pitch": ("GIMBAL.pitch",),
    "roll": ("GIMBAL.roll",),
    "aircraft_yaw": ("OSD.yaw", "OSD.yaw [360]"),
    "aircraft_pitch": ("OSD.pitch",),
    "aircraft_roll": ("OSD.roll",),
    "satellites": ("OSD.gpsNum",),
    "gps_level": ("OSD.gpsLevel",),
    "recording": ("CAMERA.isVideo", "CUSTOM.isVideo", "CAMERA_INFO.recordState", "CAMERA.recordState"),
    "camera_name": ("OSD.droneType", "DETAILS.productType", "RECOVER.droneType"),
}
_FLY_TIMES = ("OSD.flyTime [s]", "OSD.flyTime", "OSD.flyTime [formatted]")
_DATES = {"[utc]": "CUSTOM.date [UTC]", "[local]": "CUSTOM.date [local]", "": "CUSTOM.date"}


def is_dji_flight_record_csv(path: Path, head: bytes) -> bool:
    """Whether a file's head is of a decoded flight record."""
    return {"osd.latitude", "osd.longitude"} <= head_names(head)


def read_dji_flight_record_csv(telemetry: Telemetry) -> Track:
    """The samples of a file. Raises InputError if none can be used."""
    text = read_text(telemetry.file, "a decoded DJI flight record (CSV)")
    table = read_table(telemetry.file, text, telemetry.table)
    columns = columns_by_names(table, _NAMES)
    time = str(columns["time"].name).lower() if "time" in columns else ""
    zone = next(tag for tag in _DATES if tag in time)
    if ".datetime" not in time:
        columns |= columns_by_names(table, {"date": (_DATES[zone],)})
    fly_time = _finest(table, _FLY_TIMES)
    if fly_time is not None:
        # dji-log-parser does not say the unit
        columns["elapsed"] = Column(name=fly_time, unit="seconds")
    return track_of_table(table, columns | telemetry.columns)


def _finest(table: DelimitedTable, names: tuple[str, ...]) -> str | None:
    """The column with the most values: some tools write whole seconds beside ``0m 1.5s``, others tenths in both."""
    present = [name for name in names if table.index(name) is not None]
    return max(present, key=lambda name: len(set(table.column(table.index(name) or 0))), default=None)
