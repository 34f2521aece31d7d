"""A mission: the streams, the ground, the machines, and how to look."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from pipeline.config.base import Strict, load, mismatch, refuse_repeated
from pipeline.config.camera import CameraSource
from pipeline.config.units import (
    Bitrate,
    Hertz,
    Meters,
    MetersPerSecond,
    NonNegativeMeters,
    NonNegativePixels,
    NonNegativeRadians,
    PositiveMeters,
    PositiveSeconds,
    Radians,
    Seconds,
)
from pipeline.geo.surface_model import HeightUnit
from pipeline.link.codec import Codec

Fraction = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
HalfFraction = Annotated[float, Field(ge=0.0, le=0.5, allow_inf_nan=False)]
Datum = Literal["ellipsoid", "geoid"]
SignificantPoint = Literal["bottom_center", "center"]
#: width and height of a standing person, metres
PERSON_WIDTH_M, PERSON_HEIGHT_M = 0.5, 1.7


class MeshOrigin(Strict):
    """WGS84 position of a mesh's point (0, 0)."""

    latitude: Radians
    longitude: Radians

    @model_validator(mode="after")
    def _on_earth(self) -> MeshOrigin:
        for name, most_deg in (("latitude", 90.0), ("longitude", 180.0)):
            angle_deg = math.degrees(getattr(self, name))
            if abs(angle_deg) > most_deg:
                raise mismatch(f"{angle_deg:g} degrees", f"at most {most_deg:g} degrees", (name,))
        return self


class FlatGround(Strict):
    """A plane where no surface model is at hand. height: absent, that of the first flight's take-off.

    sd: how far the ground may be from it, one standard deviation; places are less sure by that.
    """

    height: Meters | None = None
    sd: PositiveMeters = 5.0


class Terrain(Strict):
    """A surface model (DSM): GeoTIFFs with a CRS, a mesh with an origin, or a plane; heights above the datum.

    file: one or several, or folders of them; where they overlap the first that knows a height counts.
    height_datum: absent, as the file says. unit, nodata: instead of what the file says. origin: where a mesh (x east,
    y north, z up, metres; PLY, OBJ, STL, OFF or GLB) lies. flat: instead of a file.
    """

    file: Path | tuple[Path, ...] | None = None
    height_datum: Datum | None = None
    unit: HeightUnit | None = None
    nodata: float | None = None
    origin: MeshOrigin | None = None
    flat: FlatGround | None = None

    @property
    def files(self) -> tuple[Path, ...]:
        """The files and folders named, in their order."""
        if self.file is None:
            return ()
        return self.file if isinstance(self.file, tuple) else (self.file,)

    @model_validator(mode="after")
    def _one_ground(self) -> Terrain:
        if bool(self.files) == (self.flat is not None):
            raise mismatch("a file and a plane" if self.files else "nothing", "file, or flat", ("file",))
        if self.origin is not None and len(self.files) != 1:
            raise mismatch(f"{len(self.files)} files", "one mesh, since there is an origin", ("file",))
        return self


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


class Stream(Strict):
    """One video, or several recordings in a row, or a folder of stills, of one camera.

    video: a file, or a list of those that a camera cut one recording into. stills: instead of it, their folder;
    each is used at the time that its EXIF says. site: where it is filmed, reached
    without a link's limit. telemetry: absent, from the video's own tracks or the stills' metadata. start, end: the
    part that is used, in time of the video, which begins with its first picture.
    """

    id: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    video: Path | tuple[Path, ...] | None = None
    stills: Path | None = None
    telemetry: Telemetry
    camera: CameraSource = CameraSource()
    site: str
    start: Seconds | None = None
    end: Seconds | None = None

    @property
    def videos(self) -> tuple[Path, ...]:
        """The video files, in their order."""
        if self.video is None:
            return ()
        return self.video if isinstance(self.video, tuple) else (self.video,)

    @property
    def pictures(self) -> Path:
        """The first video file, or the folder of the stills: what a fault of the pictures is said of."""
        return self.videos[0] if self.stills is None else self.stills

    @field_validator("video", mode="before")
    @classmethod
    def _video_is_a_path_or_paths(cls, given: Any) -> Any:
        files = given if isinstance(given, list | tuple) else [given]
        if not files or not all(isinstance(f, str | Path) and str(f) for f in files):
            raise mismatch(repr(given), "a video file, or a list of them")
        return tuple(files) if len(files) > 1 else files[0]

    @model_validator(mode="after")
    def _one_kind_of_pictures(self) -> Stream:
        if (self.video is None) == (self.stills is None):
            found = "nothing" if self.video is None else "a video and stills"
            raise mismatch(found, "video, or stills", ("video",))
        return self

    @model_validator(mode="after")
    def _part_is_ordered(self) -> Stream:
        if self.end is not None and self.end <= max(0.0, self.start or 0.0):
            raise mismatch(f"{self.end:g} s", f"more than the start, {self.start or 0.0:g} s", ("end",))
        return self

    @model_validator(mode="before")
    @classmethod
    def _telemetry_is_in_the_video(cls, given: Any) -> Any:
        if not isinstance(given, dict) or "telemetry" in given:
            return given
        pictures = given.get("video", given.get("stills"))
        return given if pictures is None else given | {"telemetry": {"file": pictures}}


class Delays(Strict):
    """What a frame's way to a detector takes beside execution; within a site nothing.

    burst: the largest packet, in mean packets of its stream.
    """

    encode: PositiveSeconds
    decode: PositiveSeconds
    burst: float = Field(default=1.0, ge=1.0, le=1000.0)


class Processing(Strict):
    """The paper's processingFrameRate, maxProcessingTime, detPerStream, detPerFrame, w; the memory rule.

    Past the paper, each off unless asked for. codecs: the plan chooses one per substream, by the pool's
    accuracy_by_codec; none: ``codec`` for all. expected_size: accuracies for the size of a person that is to
    be expected in each stream. sharing: detectors that share a machine slow each other down, as the pool has
    it. delays: max_processing_time includes encoding, transfer and decoding. decoding_threads: of each video;
    absent: the processor's cores, shared out among the streams.
    """

    frame_rate: Hertz
    max_processing_time: PositiveSeconds
    detectors_per_stream: int = Field(default=2, ge=1, le=16)
    detectors_per_frame: int = Field(default=2, ge=1, le=16)
    accuracy_weight: Fraction = 0.6
    memory_rule: Literal["ram", "one_detector_per_machine"] = "ram"
    codec: Codec = "h264"
    bitrates: tuple[Bitrate, ...] = Field(min_length=1)
    time_limit: PositiveSeconds = 30.0
    codecs: tuple[Codec, ...] = ()
    expected_size: bool = False
    sharing: bool = False
    delays: Delays | None = None
    decoding_threads: int | None = Field(default=None, ge=1, le=64)


class ObjectSize(Strict):
    """Least and greatest extent of an object of the class, metres, as it can appear in a picture."""

    width_min: PositiveMeters
    width_max: PositiveMeters
    height_min: PositiveMeters
    height_max: PositiveMeters

    @model_validator(mode="after")
    def _ordered(self) -> ObjectSize:
        if self.width_min >= self.width_max:
            raise mismatch(
                f"{self.width_min:g} m", f"less than width_max, {self.width_max:g} m", ("width_min",)
            )
        if self.height_min >= self.height_max:
            raise mismatch(
                f"{self.height_min:g} m", f"less than height_max, {self.height_max:g} m", ("height_min",)
            )
        return self


class Uncertainty(Strict):
    """Standard deviations of everything that a place is computed from; its error ellipse follows from them.

    Biases are the same for all looks of a stream, so that no number of looks averages them away; noise
    wanders with the correlation time. position: each horizontal axis; height: the vertical one; attitude:
    each of yaw, pitch and roll. box: the centre of a box in a picture. terrain: height of the surface about
    a place. body: the middle of a person from the middle of the boxes, which posture and cover move.

    The defaults are those of a drone with plain satellite positioning: open-sky receivers state 1.5 m within
    which half of the positions lie (1.5 m / 1.177 on each axis) and heights half as good again; compasses and
    gimbals are good to a degree. With RTK a mission should say so.
    """

    position_bias: NonNegativeMeters = 1.3
    height_bias: NonNegativeMeters = 2.0
    attitude_bias: NonNegativeRadians = math.radians(1.0)
    position_noise: NonNegativeMeters = 0.1
    attitude_noise: NonNegativeRadians = math.radians(0.2)
    correlation_time: PositiveSeconds = 2.0
    box: NonNegativePixels = 2.0
    terrain: NonNegativeMeters = 0.25
    body: NonNegativeMeters = 0.12


class SecondLook(Strict):
    """Which ground is worth a second look, and how a drone would look at it.

    pod_min, resolution_min (pixels per person), looks_min: seen worse than that is seen badly.
    unresolved_from: a probability from there to the threshold is undecided, if there were unresolved_looks
    observations at least. min_area (square metres): smaller areas are left out, after those closer than
    merge_distance have been made one. height (above the surface), speed, overlap (of neighbouring strips,
    0..0.9), hover: of the proposed flight.
    """

    pod_min: Fraction = 0.5
    resolution_min: NonNegativePixels = 20.0
    looks_min: int = Field(default=1, ge=0)
    unresolved_from: Fraction = 0.3
    unresolved_looks: int = Field(default=5, ge=1)
    min_area: float = Field(default=6.0, gt=0.0)
    merge_distance: PositiveMeters = 2.0
    height: PositiveMeters = 12.0
    speed: MetersPerSecond = 3.0
    overlap: float = Field(default=0.3, ge=0.0, le=0.9)
    hover: PositiveSeconds = 4.0


class ObjectClass(Strict):
    """What a class of objects looks like. id: the detectors' class id. name: of its layer of the map.

    typical_width, typical_height: of an object that was missed, for the probability of detection; absent: the
    middle between the least and the greatest.
    """

    id: int = Field(ge=0)
    name: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    significant_point: SignificantPoint
    object_size: ObjectSize
    typical_width: PositiveMeters | None = None
    typical_height: PositiveMeters | None = None


class Fusion(Strict):
    """The sensor model and the salient locations (the paper's section 'Detection fusion').

    significant_point, object_size: of persons, the detectors' class 0. further_classes: what else is mapped,
    each class in a layer of its own.
    """

    cell_size: PositiveMeters
    positive_max: HalfFraction
    negative_max: HalfFraction
    tukey_alpha: Fraction
    significant_point: SignificantPoint
    object_size: ObjectSize
    further_classes: tuple[ObjectClass, ...] = ()
    threshold: Fraction
    cluster_distance: PositiveMeters
    clamp_min: float = Field(default=0.1192, ge=0.0, lt=0.5)
    clamp_max: float = Field(default=0.971, gt=0.5, le=1.0)
    lateness: PositiveSeconds
    uncertainty: Uncertainty = Uncertainty()
    second_look: SecondLook = SecondLook()

    @model_validator(mode="after")
    def _threshold_can_be_reached(self) -> Fusion:
        if not 0.5 < self.threshold < self.clamp_max:
            expected = f"more than 0.5 and less than clamp_max, {self.clamp_max:g}"
            raise mismatch(f"{self.threshold:g}", expected, ("threshold",))
        return self

    @model_validator(mode="after")
    def _classes_are_unique(self) -> Fusion:
        for number, added in enumerate(self.further_classes):
            for kind in ("id", "name"):
                if getattr(added, kind) in [getattr(c, kind) for c in self.classes[: number + 1]]:
                    at = ("further_classes", number, kind)
                    raise mismatch(f"{getattr(added, kind)!r} again", f"every {kind} once, persons' too", at)
        return self

    @property
    def classes(self) -> tuple[ObjectClass, ...]:
        """Persons first, then the further classes."""
        person = ObjectClass.model_construct(
            id=0,
            name="person",
            significant_point=self.significant_point,
            object_size=self.object_size,
            typical_width=PERSON_WIDTH_M,
            typical_height=PERSON_HEIGHT_M,
        )
        return (person, *self.further_classes)


class Mission(Strict):
    """Everything a run reads. Paths are relative to the mission file.

    search_area: a GeoJSON polygon of the ground to search; absent: what the drones' ways enclose.
    """

    name: str
    terrain: Terrain
    streams: tuple[Stream, ...] = Field(min_length=1)
    inventory: Path
    pool: Path
    processing: Processing
    fusion: Fusion
    truth: Path | None = None
    search_area: Path | None = None

    @model_validator(mode="after")
    def _streams_are_unique(self) -> Mission:
        refuse_repeated("stream", [stream.id for stream in self.streams], at="streams")
        return self


def _resolved(telemetry: Telemetry, base: Path) -> Telemetry:
    angles = telemetry.angles
    if angles is not None:
        angles = angles.model_copy(update={"file": base / angles.file})
    first, *following = (base / file for file in telemetry.files)
    return telemetry.model_copy(update={"file": first, "following": tuple(following), "angles": angles})


def _files(base: Path, files: tuple[Path, ...]) -> Path | tuple[Path, ...]:
    paths = tuple(base / file for file in files)
    return paths if len(paths) > 1 else paths[0]


def load_mission(path: Path) -> Mission:
    """Read and validate a mission file; all paths come back resolved against it."""
    mission = load(path, Mission)
    base = path.parent
    streams = tuple(
        s.model_copy(
            update={
                "video": _files(base, s.videos) if s.videos else None,
                "stills": None if s.stills is None else base / s.stills,
                "camera": s.camera.model_copy(update={"file": s.camera.file and base / s.camera.file}),
                "telemetry": _resolved(s.telemetry, base),
            }
        )
        for s in mission.streams
    )
    return mission.model_copy(
        update={
            "streams": streams,
            "terrain": mission.terrain.model_copy(
                update={"file": tuple(base / f for f in mission.terrain.files) or None}
            ),
            "inventory": base / mission.inventory,
            "pool": base / mission.pool,
            "truth": None if mission.truth is None else base / mission.truth,
            "search_area": None if mission.search_area is None else base / mission.search_area,
        }
    )
