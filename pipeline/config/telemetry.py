"""Where the camera was and where it looked: the file that says so, and what it leaves open."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from pipeline.config.base import Strict, mismatch
from pipeline.config.stream_url import VIDEO_SCHEMES, LiveUrl, is_url, stream_url
from pipeline.config.terrain import Datum
from pipeline.config.units import Meters, PositiveSeconds, Radians, Seconds

#: what the columns of a table may hold; angles are the camera's, those of the aircraft are called so
COLUMN_QUANTITIES = (
    *("time", "date", "elapsed", "gps_week", "latitude", "longitude", "absolute_height", "relative_height"),
    *("yaw", "pitch", "roll", "aircraft_yaw", "aircraft_pitch", "aircraft_roll", "focal_length_35mm"),
    *("horizontal_sd", "height_sd", "attitude_sd", "satellites", "gps_level", "recording", "camera_name"),
)


class Column(Strict):
    """One column of a table."""

    name: str | int
    """Its name in the head, or its number, from 1. Example: `OSD.latitude`."""
    unit: str | None = None
    """Of lengths, angles and durations, such as `feet` or `radians`; of a date a pattern such as `%d/%m/%Y
    %H:%M:%S`; of a time also `gps` (seconds) and `excel` (days); of latitude and longitude also `nmea`.
    Absent: that of the head. Example: `feet`.
    """
    scale: float = Field(default=1.0, ge=-1e9, le=1e9)
    """Multiplied onto its numbers, beside the unit. Example: `-1`, for a pitch that is positive downward."""
    zone: str | None = None
    """Of a time: `utc`, `local`, an offset such as `+02:00`, or `video` (seconds since the video's first
    picture). Absent: that of the head. Example: `utc`.
    """


class Table(Strict):
    """How a table is written. What is absent is found out."""

    delimiter: str | None = Field(default=None, min_length=1, max_length=1)
    """One character between the cells. Example: `";"`."""
    decimal: Literal[".", ","] | None = None
    """Of numbers. Example: `","`."""
    head_lines: int | None = Field(default=None, ge=0, le=1000)
    """Lines before the first sample. Example: `2`."""


class FixedGimbal(Strict):
    """Angles of a camera that is fixed, or whose gimbal stands still. What is absent comes from the telemetry."""

    pitch: Radians | Literal["aircraft"] | None = None
    """From the horizon, down is negative; or, beside `yaw: aircraft`, `aircraft`: a camera without a gimbal,
    turned on the airframe by the angles of `mounting` and leaning with it. Example: `{degrees: -45}`.
    """
    roll: Radians | None = None
    """To the right is positive. Example: `{degrees: 0}`."""
    yaw: Radians | Literal["course", "aircraft"] | None = None
    """Clockwise from north, or `course` (the way the drone flies), or `aircraft` (where its nose points, plus
    the angle, if any, of `mounting`). Example: `course`.
    """

    @model_validator(mode="after")
    def _fixed_to_the_airframe_or_not(self) -> FixedGimbal:
        if self.pitch == "aircraft" and (self.yaw != "aircraft" or self.roll is not None):
            raise mismatch("pitch: aircraft", "yaw: aircraft beside it, and no roll", ("pitch",))
        return self


class Mounting(Strict):
    """Added to the angles of the telemetry: how the camera sits in what they are measured on."""

    yaw: Radians = 0.0
    """To the right is positive."""
    pitch: Radians = 0.0
    """Up is positive. Example: `{degrees: -90}`."""
    roll: Radians = 0.0
    """To the right is positive."""


def _require_known_quantities(columns: Mapping[str, Column]) -> None:
    for quantity in columns:
        if quantity not in COLUMN_QUANTITIES:
            expected = "one of " + ", ".join(COLUMN_QUANTITIES)
            raise mismatch("an unknown quantity", expected, ("columns", quantity))


class Angles(Strict):
    """A second file, from which the camera's angles are taken."""

    file: Path
    """Of any format that telemetry may have. Example: `gimbal.csv`."""
    format: str = "auto"
    """`auto`, or a format's name."""
    time_offset: Seconds | None = None
    """Added to the file's time to get the video's. Absent: by the dates of both files. Example: `{seconds:
    2.5}`.
    """
    columns: dict[str, Column] = Field(default_factory=dict)
    """Of a table: what each column is. Example: `{time: {name: Time}, yaw: {name: Yaw}}`."""
    table: Table = Table()
    """How a table is written."""

    @model_validator(mode="after")
    def _columns_are_known(self) -> Angles:
        _require_known_quantities(self.columns)
        return self


class Telemetry(Strict):
    """Where the camera was and where it looked."""

    file: Path
    """One file, or a list of one for each recording of the stream. Beside a live stream: a file that is being
    written, or the port that MAVLink is sent to, `udp://0.0.0.0:14550`. Example: `DJI_0001.SRT`.
    """
    following: tuple[Path, ...] = ()
    """Where a list of files is kept once it is read; in a mission, give the list as `file`. Example:
    `[DJI_0002.SRT]`.
    """
    heard: LiveUrl | None = None
    """Where a URL is kept once it is read; in a mission, give it as `file`. Example: `udp://0.0.0.0:14550`."""
    format: str = "auto"
    """`auto`, or the name of a format of [telemetry.md](telemetry.md)."""
    time_offset: Seconds | None = None
    """Added to the telemetry's time to get the video's. Absent: found out. Example: `{seconds: -1.2}`."""
    utc_offset: Seconds | None = None
    """Local time minus UTC, where a file's times are local. Absent: results say local time. Example: `{hours:
    2}`.
    """
    height: Literal["absolute", "relative"] = "absolute"
    """Which of the heights is used: `absolute` is above `height_datum`, `relative` above `takeoff_height`."""
    height_datum: Datum | None = None
    """What absolute heights are above. Absent: as the file says, else you are asked."""
    takeoff_height: Meters | None = None
    """Of the take-off point, above the terrain's datum. Absent: the ground under the first sample. Example:
    `{meters: 93.3}`.
    """
    flight_height: Meters | None = None
    """Above take-off, of a flight at one height, for a file that has none. Example: `{meters: 40}`."""
    geoid_undulation: Meters | None = None
    """Height of the geoid above the ellipsoid there. Absent: of a geoid model. Example: `{meters: 29.4}`."""
    columns: dict[str, Column] = Field(default_factory=dict)
    """Of a table, or instead of what a known format says: what each column is; the keys are those of
    [telemetry.md](telemetry.md#a-table-of-ones-own). Example: `{time: {name: Time, zone: utc}, latitude:
    {name: Lat}}`.
    """
    table: Table = Table()
    """How a table is written."""
    angles: Angles | None = None
    """A second file, with the camera's angles."""
    gimbal: FixedGimbal = FixedGimbal()
    """Angles that the telemetry lacks."""
    mounting: Mounting = Mounting()
    """How the camera sits on what the angles are of."""
    yaw_offset: Radians = 0.0
    """Added to every yaw, to the right is positive. Example: `{degrees: 1.5}`."""
    longest_gap: PositiveSeconds = 3.0
    """Between two samples that a pose may be interpolated over."""
    gps_order: Literal["longitude_first", "latitude_first"] | None = None
    """Of `GPS(a, b, height)` in DJI's subtitles. Absent: latitude first, as the drones that write a height do."""
    sensor_azimuth: Literal["relative", "absolute"] | None = None
    """What the camera's angles in MISB metadata count from, the aircraft (`relative`) or north (`absolute`).
    Absent: as the frame centres tell.
    """
    system_id: int | None = Field(default=None, ge=1, le=255)
    """The vehicle, in a MAVLink log of several. Example: `1`."""

    @property
    def files(self) -> tuple[Path, ...]:
        """Of each recording, in their order; one alone may be of all."""
        return (self.file, *self.following)

    @model_validator(mode="before")
    @classmethod
    def _first_and_following(cls, given: Any) -> Any:
        if not isinstance(given, dict):
            return given
        if is_url(given.get("file")):
            heard = stream_url(given["file"], tuple(VIDEO_SCHEMES))
            return given | {"heard": heard, "file": Path(str(heard))}
        if not isinstance(given.get("file"), list | tuple):
            return given
        if not given["file"]:
            raise mismatch("an empty list", "a file, or one for each recording", ("file",))
        first, *following = given["file"]
        return given | {"file": first, "following": following}

    @model_validator(mode="after")
    def _columns_are_known(self) -> Telemetry:
        _require_known_quantities(self.columns)
        return self
