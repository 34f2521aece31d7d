"""The columns of a table as numbers: metres, degrees, flags, one array per quantity."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from pipeline.config.telemetry import Column
from pipeline.errors import InputError
from pipeline.ingest.tables.cells import degrees, flags, nmea_degrees, numbers
from pipeline.ingest.tables.delimited import DelimitedTable
from pipeline.ingest.tables.units import Dimension, factor, split_unit, unit_names
from pipeline.messages import FloatArray

CAMERA = ("yaw", "pitch", "roll")
AIRCRAFT = ("aircraft_yaw", "aircraft_pitch", "aircraft_roll")
_LENGTHS = ("absolute_height", "relative_height", "horizontal_sd", "height_sd")
_ANGLES = (*CAMERA, *AIRCRAFT, "attitude_sd")
_PLAIN = ("satellites", "gps_level", "focal_length_35mm")
#: no angle of a camera or an aircraft is greater, in degrees
_MOST_DEG = 360.0
#: no gimbal is pitched or rolled further
_MOST_PITCH_DEG = 140.0
#: a camera that searches is pitched by more degrees than a right angle has radians, at some time
_LEAST_PITCH, _TURN_RAD = 0.05, 2.0 * math.pi


@dataclass
class TableColumns:
    """values: float64 (N,) by quantity, metres and degrees, NaN where a cell holds nothing that can be read.

    assumed: what had to be assumed, a sentence each.
    """

    table: DelimitedTable
    columns: dict[str, Column]
    values: dict[str, FloatArray] = field(default_factory=dict)
    assumed: list[str] = field(default_factory=list)

    def get(self, quantity: str) -> FloatArray:
        """float64 (N,), NaN where the table has no such column."""
        return self.values.get(quantity, np.full(len(self.table.rows), math.nan))


def read_columns(table: DelimitedTable, columns: dict[str, Column]) -> TableColumns:
    """All but the times. Raises InputError if a column is not there, is needed, or has an unknown unit."""
    _require_columns(table, columns)
    read = TableColumns(table, columns)
    for quantity, column in columns.items():
        index = table.index(column.name)
        assert index is not None
        values = _read(read, quantity, table.column(index))
        if values is not None:
            read.values[quantity] = values * column.scale
    for angles in (CAMERA, AIRCRAFT):
        _tenths_to_degrees(read, angles)
    _require_degrees(read)
    return read


def _require_columns(table: DelimitedTable, columns: dict[str, Column]) -> None:
    where = f"{table.path} telemetry.columns"
    for quantity, column in columns.items():
        if table.index(column.name) is None:
            names = ", ".join(table.names[:12]) + (", .." if len(table.names) > 12 else "")
            raise InputError(f"{where}.{quantity}.name", f"no column {column.name!r}", f"one of {names}")
    angles_only = not {"latitude", "longitude"} & columns.keys() and {"yaw", "pitch"} & columns.keys()
    for quantity in ("time",) if angles_only else ("time", "latitude", "longitude"):
        if quantity not in columns and not (quantity == "time" and "elapsed" in columns):
            raise InputError(where, f"no {quantity}", f"{quantity}: {{name: its column}}")


def _read(read: TableColumns, quantity: str, cells: list[str]) -> FloatArray | None:
    if quantity in ("latitude", "longitude"):
        return _position(read, quantity, cells)
    if quantity in _LENGTHS:
        return _scaled(read, quantity, cells, "length")
    if quantity in _ANGLES:
        return _scaled(read, quantity, cells, "angle")
    if quantity == "recording":
        return flags(cells)
    return numbers(cells, read.table.decimal) if quantity in _PLAIN else None


def _position(read: TableColumns, quantity: str, cells: list[str]) -> FloatArray:
    unit = (read.columns[quantity].unit or "").lower()
    if unit in ("nmea", "ddmm.mmmm"):
        return np.array([nmea_degrees(cell) for cell in cells], np.float64)
    values = np.array([degrees(cell, read.table.decimal) for cell in cells], np.float64)
    return values * _factor(read, quantity, "angle")


def _scaled(read: TableColumns, quantity: str, cells: list[str], dimension: Dimension) -> FloatArray:
    values = numbers(cells, read.table.decimal, dimension)
    return values * _factor(read, quantity, dimension)


def _factor(read: TableColumns, quantity: str, dimension: Dimension) -> float:
    """Of the unit that the mission states, or the head; else metres or degrees, and that is said."""
    column = read.columns[quantity]
    if column.unit:
        stated = factor(column.unit, dimension)
        if stated is None:
            where = f"{read.table.path} telemetry.columns.{quantity}.unit"
            raise InputError(where, repr(column.unit), f"one of {unit_names(dimension)}")
        return stated
    head = split_unit(read.table.names[read.table.index(column.name) or 0])[1]
    scale = factor(head, dimension) if head else None
    if scale is not None:
        return scale
    if quantity not in ("latitude", "longitude") and dimension == "length":
        read.assumed.append(f"{quantity} ({column.name}) is in metres: the head does not say its unit")
    return 1.0


def _tenths_to_degrees(read: TableColumns, angles: tuple[str, ...]) -> None:
    """Angles that no degrees can be, in more than one row of twenty, are tenths: all angles of that device.

    Tenths are whole numbers. A heading alone that goes on beyond a turn, twice at most, is one that was not cut back.
    """
    if any(read.columns[name].unit for name in angles if name in read.columns):
        return
    present = [name for name in angles if name in read.values]
    beyond = {n: np.mean(np.abs(np.nan_to_num(read.values[n])) > _MOST_DEG) for n in present}
    if not present or max(beyond.values()) < 0.05:
        return
    whole = all((np.nan_to_num(read.values[n]) % 1.0 == 0.0).all() for n in present)
    heading, *others = angles
    alone = all(beyond.get(name, 0.0) < 0.05 and _most(read, name) <= _MOST_PITCH_DEG for name in others)
    if heading in present and alone and not (whole and _most(read, heading) > 2.0 * _MOST_DEG):
        read.values[heading] = np.mod(read.values[heading] + 180.0, 360.0) - 180.0
        read.assumed.append(f"{heading} goes on beyond a whole turn: full turns are taken off")
        return
    if not whole:
        return  # samples that cannot be are left out one by one, and counted
    for name in present:
        read.values[name] = read.values[name] / 10.0
    read.assumed.append(f"{', '.join(present)} are in tenths of a degree: their values are greater than 360")


def _most(read: TableColumns, name: str) -> float:
    values = read.get(name)
    return float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else 0.0


def _require_degrees(read: TableColumns) -> None:
    """Raises InputError if the camera's angles look like radians and nothing says what they are."""
    given = [name for name in ("yaw", "pitch") if np.isfinite(read.get(name)).any()]
    if len(given) < 2 or any(_stated_unit(read, name) for name in given):
        return
    pitch = np.abs(read.get("pitch")[np.isfinite(read.get("pitch"))])
    if not _LEAST_PITCH < float(np.median(pitch)) <= float(pitch.max()) <= math.pi / 2.0 + 0.01:
        return
    if _most(read, "yaw") <= _TURN_RAD:
        where = f"{read.table.path} telemetry.columns.pitch.unit"
        found = (
            f"no unit for a pitch of at most {pitch.max():.2f} and a yaw of at most {_most(read, 'yaw'):.2f}"
        )
        raise InputError(
            where, found, "radians or degrees, in the head or in telemetry.columns (yaw, pitch, roll)"
        )


def _stated_unit(read: TableColumns, name: str) -> str:
    column = read.columns[name]
    return column.unit or split_unit(read.table.names[read.table.index(column.name) or 0])[1]
