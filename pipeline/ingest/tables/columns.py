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
            read.values[quantity] = values
    for angles in (CAMERA, AIRCRAFT):
        _tenths_to_degrees(read, angles)
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
    """Angles that no degrees can be, in more than one row of twenty, are tenths: all angles of that device."""
    if any(read.columns[name].unit for name in angles if name in read.columns):
        return
    present = [name for name in angles if name in read.values]
    beyond = [np.mean(np.abs(np.nan_to_num(read.values[name])) > _MOST_DEG) for name in present]
    if not present or max(beyond) < 0.05:
        return
    for name in present:
        read.values[name] = read.values[name] / 10.0
    read.assumed.append(f"{', '.join(present)} are in tenths of a degree: their values are greater than 360")
