"""Where the camera was and where it looked: the file that says so, and what it leaves open."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from pipeline.config.base import Strict, mismatch
from pipeline.config.terrain import Datum
from pipeline.config.units import Meters, PositiveSeconds, Radians, Seconds

#: what the columns of a table may hold; angles are the camera's, those of the aircraft are called so
COLUMN_QUANTITIES = (
    *("time", "date", "elapsed", "gps_week", "latitude", "longitude", "absolute_height", "relative_height"),
    *("yaw", "pitch", "roll", "aircraft_yaw", "aircraft_pitch", "aircraft_roll", "focal_length_35mm"),
    *("horizontal_sd", "height_sd", "attitude_sd", "satellites", "gps_level", "recording", "camera_name"),
)


class Column(Strict):
    """One column of a table. name: in the head, or a number from 1. unit, zone: absent, those of the head.

    unit: of lengths, angles and durations; of a date a pattern such as ``%d/%m/%Y %H:%M:%S``; of a time also
    ``gps`` (seconds) and ``excel`` (days); of latitude and longitude also ``nmea``. zone: of a time, ``utc``,
    ``local``, an offset such as ``+02:00``, or ``video`` (seconds since the video's first picture).
    """

    name: str | int
    unit: str | None = None
    zone: str | None = None


class Table(Strict):
    """How a table is written; absent: found out. head_lines: lines before the first sample."""

    delimiter: str | None = Field(default=None, min_length=1, max_length=1)
    decimal: Literal[".", ","] | None = None
    head_lines: int | None = Field(default=None, ge=0, le=1000)


class FixedGimbal(Strict):
    """Angles of a camera that is fixed, or whose gimbal stands still. Absent: those of the telemetry.

    yaw: clockwise from north, or ``course`` (the way the drone flies), or ``aircraft`` (where its nose points,
    plus the angle, if any, of ``mounting``). pitch: from the horizon, or, beside ``yaw: aircraft``, ``aircraft``:
    a camera without a gimbal, turned on the airframe by the angles of ``mounting`` and leaning with it.
    """

    pitch: Radians | Literal["aircraft"] | None = None
    roll: Radians | None = None
    yaw: Radians | Literal["course", "aircraft"] | None = None

    @model_validator(mode="after")
    def _fixed_to_the_airframe_or_not(self) -> FixedGimbal:
        if self.pitch == "aircraft" and (self.yaw != "aircraft" or self.roll is not None):
            raise mismatch("pitch: aircraft", "yaw: aircraft beside it, and no roll", ("pitch",))
        return self


class Mounting(Strict):
    """Added to the angles of the telemetry: how the camera sits in what they are measured on."""

    yaw: Radians = 0.0
    pitch: Radians = 0.0
    roll: Radians = 0.0


def _require_known_quantities(columns: Mapping[str, Column]) -> None:
    for quantity in columns:
        if quantity not in COLUMN_QUANTITIES:
            expected = "one of " + ", ".join(COLUMN_QUANTITIES)
            raise mismatch("an unknown quantity", expected, ("columns", quantity))


class Angles(Strict):
    """A second file, from which the camera's angles are taken. columns, table: as of the telemetry.

    time_offset: added to the file's time to get the video's; absent: by the dates of both files.
    """

    file: Path
    format: str = "auto"
    time_offset: Seconds | None = None
    columns: dict[str, Column] = Field(default_factory=dict)
    table: Table = Table()

    @model_validator(mode="after")
    def _columns_are_known(self) -> Angles:
        _require_known_quantities(self.columns)
        return self


class Telemetry(Strict):
    """Where the camera was. file: may be a list, of one for each recording of the stream.

    time_offset is added to the telemetry's time to get the video's; absent: found out.

    format: ``auto``, or the name of one that ``searchlight check`` lists. height: which height field to use;
    ``absolute`` is above height_datum, ``relative`` above takeoff_height (absent: the ground under the first
    sample). flight_height: above take-off, of a flight at one height, for a file with none. geoid_undulation:
    height of the geoid above the ellipsoid there; absent: of a geoid model.
    utc_offset: local time minus UTC, where a file's times are local. yaw_offset: added to every yaw.
    longest_gap: between two samples that a pose may be interpolated over. gps_order: of ``GPS(a, b, height)``
    in DJI's subtitles; absent: latitude first, as the drones that write a height do. sensor_azimuth: what the
    camera's angles in MISB metadata count from, the aircraft (``relative``) or north (``absolute``); absent: as
    the frame centres tell. system_id: the vehicle, in a MAVLink log of several.
    """

    file: Path
    following: tuple[Path, ...] = ()
    format: str = "auto"
    time_offset: Seconds | None = None
    utc_offset: Seconds | None = None
    height: Literal["absolute", "relative"] = "absolute"
    height_datum: Datum | None = None
    takeoff_height: Meters | None = None
    flight_height: Meters | None = None
    geoid_undulation: Meters | None = None
    columns: dict[str, Column] = Field(default_factory=dict)
    table: Table = Table()
    angles: Angles | None = None
    gimbal: FixedGimbal = FixedGimbal()
    mounting: Mounting = Mounting()
    yaw_offset: Radians = 0.0
    longest_gap: PositiveSeconds = 3.0
    gps_order: Literal["longitude_first", "latitude_first"] | None = None
    sensor_azimuth: Literal["relative", "absolute"] | None = None
    system_id: int | None = Field(default=None, ge=1, le=255)

    @property
    def files(self) -> tuple[Path, ...]:
        """Of each recording, in their order; one alone may be of all."""
        return (self.file, *self.following)

    @model_validator(mode="before")
    @classmethod
    def _first_and_following(cls, given: Any) -> Any:
        if not isinstance(given, dict) or not isinstance(given.get("file"), list | tuple):
            return given
        if not given["file"]:
            raise mismatch("an empty list", "a file, or one for each recording", ("file",))
        first, *following = given["file"]
        return given | {"file": first, "following": following}

    @model_validator(mode="after")
    def _columns_are_known(self) -> Telemetry:
        _require_known_quantities(self.columns)
        return self
