"""Flight logs as the app Litchi writes them: ``latitude,longitude,altitude(m),..,gimbalPitchRaw,..``.

The altitude is above take-off, in the unit that the head says. Raw angles are in tenths of a degree; some
versions write degrees there, which shows beside the aircraft's angles, written in both.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.config.telemetry import Column, Telemetry
from pipeline.ingest.tables.cells import numbers
from pipeline.ingest.tables.delimited import DelimitedTable, read_table
from pipeline.ingest.tables.known_names import columns_by_names, head_names
from pipeline.ingest.tables.track import track_of_table
from pipeline.ingest.text import read_text
from pipeline.ingest.track import Track

_NAMES = {
    "time": ("datetime(utc)", "datetime(local)", "datetime"),
    "elapsed": ("time(millisecond)",),
    "latitude": ("latitude",),
    "longitude": ("longitude",),
    "relative_height": ("altitude",),
    "yaw": ("gimbalYaw", "gimbalYawRaw", "gimbal_heading"),
    "pitch": ("gimbalPitch", "gimbalPitchRaw", "gimbal_pitch"),
    "roll": ("gimbalRoll", "gimbalRollRaw", "gimbal_roll"),
    "aircraft_yaw": ("yaw",),
    "aircraft_pitch": ("pitch",),
    "aircraft_roll": ("roll",),
    "satellites": ("satellites",),
    "recording": ("isTakingVideo",),
    "camera_name": ("Dronetype", "Planename"),
}
_RAW_AND_PLAIN = (("yawRaw", "yaw"), ("pitchRaw", "pitch"), ("rollRaw", "roll"))


def is_litchi_csv(path: Path, head: bytes) -> bool:
    """Whether a file's head is Litchi's."""
    names = head_names(head)
    return {"latitude", "longitude"} <= names and bool({"gimbalpitchraw", "istakingvideo"} & names)


def read_litchi_csv(telemetry: Telemetry) -> Track:
    """The samples of a file. Raises InputError if none can be used."""
    text = read_text(telemetry.file, "a flight log of Litchi (CSV)")
    table = read_table(telemetry.file, text, telemetry.table)
    columns = columns_by_names(table, _NAMES)
    unit = _unit_of_raw(table)
    for angle in ("yaw", "pitch", "roll"):
        if angle in columns and str(columns[angle].name).endswith("Raw"):
            columns[angle] = Column(name=columns[angle].name, unit=unit)
    return track_of_table(table, columns | telemetry.columns)


def _unit_of_raw(table: DelimitedTable) -> str:
    """Tenths of a degree, unless the aircraft's raw angles equal those in degrees beside them."""
    for raw, plain in _RAW_AND_PLAIN:
        columns = columns_by_names(table, {"raw": (raw,), "plain": (plain,)})
        if len(columns) < 2:
            continue
        raw_values, values = (
            numbers(table.column(table.index(c.name) or 0), table.decimal) for c in columns.values()
        )
        both = np.isfinite(raw_values) & (np.abs(values) > 1.0)
        if both.any():
            return "degrees" if np.median(raw_values[both] / values[both]) < 3.0 else "ddeg"
    return "ddeg"
