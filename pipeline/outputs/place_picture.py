"""A picture of a place: what was seen there, when, and where in the video it is."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pipeline.ingest.in_file import InFile
from pipeline.ingest.track import Clock
from pipeline.outputs.times import iso_time

#: within a run directory
FOLDER = "crops"


@dataclass(frozen=True, eq=False)
class PlacePicture:
    """place: the id of a found or possible place. png: what was seen. stream, time_ns: by whom and when, ns UTC.

    at: the file and the picture in it; None where that is not known any more, as of an earlier flight.
    """

    place: int
    png: bytes = field(repr=False)
    stream: str
    time_ns: int
    at: InFile | None = None

    @property
    def path(self) -> str:
        """Of its file, within the run directory."""
        return f"{FOLDER}/place-{self.place}.png"


def picture_json(picture: PlacePicture, clock: Clock) -> dict[str, Any]:
    """All but the picture itself, which is in its file."""
    said: dict[str, Any] = {
        "picture": picture.path,
        "stream": picture.stream,
        "time": iso_time(picture.time_ns, clock),
    }
    at = picture.at
    if at is not None:
        said["file"] = at.name
        if at.time_s is not None:
            said |= {"file_s": round(at.time_s, 3), "frame": at.frame}
    return said


def minutes_seconds(seconds: float) -> str:
    """``02:07.3``; a tenth is cut."""
    tenths = int(10 * seconds + 1e-6)
    return f"{tenths // 600:02d}:{tenths // 10 % 60:02d}.{tenths % 10}"
