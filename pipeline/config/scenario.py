"""A scenario: a place, the people in it, and the flight that is simulated over them."""

from __future__ import annotations

import math
from datetime import datetime, timedelta
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from pipeline.config.base import Strict, load, mismatch
from pipeline.config.camera import Calibration
from pipeline.config.fusion import Fusion
from pipeline.config.processing import Processing
from pipeline.config.units import (
    BitsPerSecond,
    Hertz,
    Meters,
    MetersPerSecond,
    PositiveMeters,
    PositiveSeconds,
    Radians,
    Seconds,
)

_MISSION_SEED_LIMIT = 900_000


class Origin(Strict):
    """WGS84 position of the area's middle; height: mean ground height above the ellipsoid."""

    latitude: Radians
    longitude: Radians
    height: Meters

    @field_validator("latitude")
    @classmethod
    def _on_utm(cls, value: float) -> float:
        if not math.radians(-80.0) <= value <= math.radians(84.0):
            raise ValueError("expected a latitude between -80 and 84 degrees")
        return value

    @field_validator("longitude")
    @classmethod
    def _on_earth(cls, value: float) -> float:
        if not abs(value) <= math.pi:
            raise ValueError("expected a longitude between -180 and 180 degrees")
        return value


class Area(Strict):
    """The searched rectangle, metres east (width) and north (depth)."""

    width: Annotated[PositiveMeters, Field(ge=20.0, le=1000.0)]
    depth: Annotated[PositiveMeters, Field(ge=20.0, le=1000.0)]


class People(Strict):
    """places: how many people. half_hidden: so many with something in front. walkers: so many walk."""

    places: int = Field(ge=0, le=200)
    half_hidden: int = Field(ge=0)
    walkers: int = Field(ge=0)
    walking_speed: MetersPerSecond
    apart: PositiveMeters


class Hover(Strict):
    """A place to stay at, and where to look. heading: clockwise from north."""

    east: Meters
    north: Meters
    heading: Radians


class FlightPlan(Strict):
    """A lawn-mower pattern, the lanes split between the drones.

    height: above the smoothed ground. pitch: of the camera, negative is down.
    longest: the flight ends then at last. hover: one drone stays there for so long instead.
    """

    drones: int = Field(ge=1, le=26)
    height: PositiveMeters
    speed: Annotated[MetersPerSecond, Field(gt=0.0)]
    pitch: Radians
    lane_spacing: PositiveMeters
    longest: PositiveSeconds
    hover: Hover | None = None

    @field_validator("pitch")
    @classmethod
    def _down(cls, value: float) -> float:
        if not math.radians(-90.0) <= value <= math.radians(-20.0):
            raise ValueError("expected a pitch between -90 and -20 degrees")
        return value

    @model_validator(mode="after")
    def _one_hovers(self) -> FlightPlan:
        if self.hover is not None and self.drones != 1:
            raise mismatch(f"{self.drones} drones", "1, since it hovers", ("drones",))
        return self


class Recording(Strict):
    """The H.264 file. frame_rate: constant, a whole number of hertz. bitrate: mean. preset: of x264."""

    frame_rate: Hertz
    bitrate: BitsPerSecond
    preset: Literal["ultrafast", "veryfast", "fast", "medium", "slow", "slower"]

    @field_validator("frame_rate")
    @classmethod
    def _whole(cls, value: float) -> float:
        if value != round(value):
            raise ValueError("expected a whole number of hertz")
        return value


class SurfaceModel(Strict):
    """The terrain file. cell: of the grid. margin: how far it reaches beyond the area."""

    cell: PositiveMeters
    margin: PositiveMeters


class PoseNoise(Strict):
    """Errors of the telemetry, never of the picture: Gauss-Markov with these deviations.

    position: each axis. attitude: each angle. correlation_time: of both. time_offset: the telemetry tells
    the pose that the camera has so much later.
    """

    position: Meters
    attitude: Radians
    correlation_time: PositiveSeconds
    time_offset: Seconds


class MissionPart(Strict):
    """What goes into the mission file as it is. inventory, pool: relative to the scenario file."""

    inventory: Path
    pool: Path
    processing: Processing
    fusion: Fusion


class Scenario(Strict):
    """Everything that a simulated mission is made from.

    seed: of the place, the people and all noise. boxes_every: the truth has the boxes of every n-th frame.
    """

    name: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    seed: int = Field(ge=0, lt=_MISSION_SEED_LIMIT)
    origin: Origin
    area: Area
    start: datetime
    people: People
    camera: Calibration
    flight: FlightPlan
    recording: Recording
    surface_model: SurfaceModel
    pose_noise: PoseNoise
    boxes_every: int = Field(ge=1)
    mission: MissionPart

    @field_validator("start")
    @classmethod
    def _utc(cls, value: datetime) -> datetime:
        if value.utcoffset() != timedelta(0):
            raise ValueError("expected a time in UTC, such as 2026-06-01T10:00:00Z")
        return value


def load_scenario(path: Path) -> Scenario:
    """Read and validate a scenario file; inventory and pool come back resolved against it."""
    scenario = load(path, Scenario)
    mission = scenario.mission
    base = path.resolve().parent
    found = {"inventory": base / mission.inventory, "pool": base / mission.pool}
    return scenario.model_copy(update={"mission": mission.model_copy(update=found)})
