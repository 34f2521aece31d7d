"""A mission: the streams, the ground, the machines, and how to look."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import Field, field_validator, model_validator

from pipeline.config.base import Strict, load, mismatch, refuse_repeated
from pipeline.config.camera import CameraSource
from pipeline.config.cover import Cover
from pipeline.config.fusion import Fusion
from pipeline.config.live import Live
from pipeline.config.outputs import Outputs
from pipeline.config.prior import Prior
from pipeline.config.processing import Processing
from pipeline.config.stream_url import VIDEO_SCHEMES, StreamUrl, is_url, stream_url
from pipeline.config.telemetry import Telemetry
from pipeline.config.terrain import Terrain
from pipeline.config.units import Seconds


class Stream(Strict):
    """One camera: a video, several recordings in a row, a folder of stills, or a live stream."""

    id: str = Field(pattern=r"^[A-Za-z0-9_.-]+$")
    """Letters, digits, `_`, `.`, `-`. Example: `drone-1`."""
    video: StreamUrl | Path | tuple[Path, ...] | None = None
    """A file, or a list of those that a camera cut one recording into, or the URL of a [live stream](live.md).
    Example: `[DJI_0001.MP4, DJI_0002.MP4]`.
    """
    live: Live = Live()
    """Of a live stream: how long it is waited for."""
    stills: Path | None = None
    """Their folder, instead of a video; each is used at the time that its EXIF says. Example: `photos/`."""
    telemetry: Telemetry
    """Absent: from the video's own tracks, or the stills' metadata."""
    camera: CameraSource = CameraSource()
    """Its focal length and lens. Absent: from the metadata."""
    site: str
    """Where it is filmed, a site of the inventory, reached without a link's limit. Example: `drone-1`."""
    priority: int = Field(default=0, ge=-1000, le=1000)
    """Among the streams, when in flight not all can be looked at any more: the greatest stays. Example: `1`."""
    start: Seconds | None = None
    """Of the part that is used, in time of the video, which begins with its first picture. Example: `{seconds:
    30}`.
    """
    end: Seconds | None = None
    """Of the part that is used; later than `start`. Example: `{minutes: 5}`."""

    @property
    def videos(self) -> tuple[Path, ...]:
        """The video files, in their order."""
        if self.video is None or isinstance(self.video, StreamUrl):
            return ()
        return self.video if isinstance(self.video, tuple) else (self.video,)

    @property
    def url(self) -> StreamUrl | None:
        """Of a live stream."""
        return self.video if isinstance(self.video, StreamUrl) else None

    @property
    def pictures(self) -> Path:
        """The first video file, the folder of the stills, or the stream: what a fault of the pictures is said of."""
        if self.url is not None:
            return Path(str(self.url))
        return self.videos[0] if self.stills is None else self.stills

    @field_validator("video", mode="before")
    @classmethod
    def _video_is_a_path_or_paths(cls, given: Any) -> Any:
        if isinstance(given, StreamUrl):
            return given
        files = given if isinstance(given, list | tuple) else [given]
        if any(is_url(file) for file in files):
            if len(files) > 1:
                raise mismatch("a URL among several videos", "one live stream, or a list of files")
            return stream_url(files[0], tuple(VIDEO_SCHEMES))
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
    def _live_is_live(self) -> Stream:
        if self.url is not None and (self.start is not None or self.end is not None):
            raise mismatch("a part of a live stream", "start and end of a file only", ("video",))
        if self.url is None and "live" in self.model_fields_set:
            raise mismatch("live beside a file", "it with a video that is a URL", ("live",))
        heard = self.telemetry.heard
        if self.url is None and heard is not None:
            raise mismatch("live telemetry of a video that is a file", "a file", ("telemetry", "file"))
        if heard not in (None, self.url) and heard.scheme != "udp":
            found = f"{heard}, which is not this stream's video"
            raise mismatch(found, "a udp:// port that MAVLink is sent to", ("telemetry", "file"))
        if self.url is not None and (self.telemetry.angles is not None or self.telemetry.following):
            raise mismatch("several telemetry files of a live stream", "one", ("telemetry",))
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


class Mission(Strict):
    """Everything that a run reads. Paths are relative to the file that names them."""

    name: str
    """Of the mission, in reports. Example: `lake-north`."""
    terrain: Terrain
    """The ground."""
    streams: tuple[Stream, ...] = Field(min_length=1)
    """One or more."""
    inventory: Path
    """The [inventory](#inventory): sites, machines, links. Example: `inventory.yaml`."""
    pool: Path
    """The [pool](#pool) of detectors. Example: `pool.yaml`."""
    processing: Processing
    """What the plan may do."""
    fusion: Fusion = Fusion()
    """How detections become a map. Absent: by the defaults."""
    truth: Path | None = None
    """Where the people really were (GeoJSON points), to be compared with. Example: `people.geojson`."""
    search_area: Path | None = None
    """A GeoJSON polygon of the ground to search. Absent: what the drones' ways enclose. Example:
    `area.geojson`.
    """
    cover: tuple[Cover, ...] = ()
    """Where people are hidden from the air. Absent: nowhere. Example: `[{file: forest.geojson, hidden: 0.6}]`."""
    prior: Prior | None = None
    """Where the missing person may be, before anybody has looked. Absent: as likely everywhere."""
    outputs: Outputs = Outputs()
    """What a run writes for people and other tools. Absent: by the defaults."""

    @model_validator(mode="after")
    def _streams_are_unique(self) -> Mission:
        refuse_repeated("stream", [stream.id for stream in self.streams], at="streams")
        return self

    @model_validator(mode="after")
    def _all_fly_at_one_time(self) -> Mission:
        live = [stream.url is not None for stream in self.streams]
        if any(live) and not all(live):
            found = "live streams beside recordings, which are of another time"
            raise mismatch(
                found, "live streams only, or recordings only", ("streams", live.index(False), "video")
            )
        return self

    @property
    def is_live(self) -> bool:
        """Whether it films while it runs."""
        return any(stream.url is not None for stream in self.streams)


def _resolved(telemetry: Telemetry, base: Path) -> Telemetry:
    angles = telemetry.angles
    if angles is not None:
        angles = angles.model_copy(update={"file": base / angles.file})
    if telemetry.heard is not None:
        return telemetry
    first, *following = (base / file for file in telemetry.files)
    return telemetry.model_copy(update={"file": first, "following": tuple(following), "angles": angles})


def _prior(prior: Prior | None, base: Path) -> Prior | None:
    if prior is None or prior.file is None:
        return prior
    return prior.model_copy(update={"file": base / prior.file})


def _files(base: Path, files: tuple[Path, ...]) -> Path | tuple[Path, ...]:
    paths = tuple(base / file for file in files)
    return paths if len(paths) > 1 else paths[0]


def _terrain(terrain: Terrain, base: Path) -> Terrain:
    fallback = terrain.fallback
    if fallback is not None:
        fallback = fallback.model_copy(update={"file": tuple(base / f for f in fallback.files) or None})
    files = tuple(base / f for f in terrain.files) or None
    return terrain.model_copy(update={"file": files, "fallback": fallback})


def load_mission(path: Path) -> Mission:
    """Read and validate a mission file; all paths come back resolved against it."""
    mission = load(path, Mission)
    base = path.parent
    streams = tuple(
        s.model_copy(
            update={
                "video": _files(base, s.videos) if s.videos else s.url,
                "live": s.live.model_copy(update={"record": s.live.record and base / s.live.record}),
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
            "terrain": _terrain(mission.terrain, base),
            "inventory": base / mission.inventory,
            "pool": base / mission.pool,
            "truth": None if mission.truth is None else base / mission.truth,
            "search_area": None if mission.search_area is None else base / mission.search_area,
            "cover": tuple(c.model_copy(update={"file": base / c.file}) for c in mission.cover),
            "prior": _prior(mission.prior, base),
        }
    )
