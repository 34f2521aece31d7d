"""The unit of work: one sequence under one codec and bitrate, looked at by every detector."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pipeline.link.codec import Codec


@dataclass(frozen=True, slots=True)
class Condition:
    """codec, bitrate_bps: what the pictures went through; None: they are looked at as they are."""

    codec: Codec | None = None
    bitrate_bps: float | None = None

    def __str__(self) -> str:
        if self.codec is None or self.bitrate_bps is None:
            return "source"
        return f"{self.codec} at {self.bitrate_bps / 1e3:g} kbps"


@dataclass(frozen=True, slots=True)
class Model:
    """An open-able detector. sha256: of the file."""

    id: str
    path: Path
    sha256: str
    provider: str = "cpu"


@dataclass(frozen=True, slots=True)
class Unit:
    """All that a process needs to know; it can be sent anywhere where the files are.

    kept: frames that are encoded, rising. looked: frame -> number of the picture. size: width, height of the
    encoded picture, None: as it is. keyframe_interval: frames. packets: where the encoded stream is kept.
    """

    sequence: str
    files: tuple[Path, ...]
    is_video: bool
    frame_rate_hz: float
    kept: tuple[int, ...]
    looked: dict[int, int]
    size: tuple[int, int] | None
    condition: Condition
    keyframe_interval: int
    models: tuple[Model, ...]
    score_cutoff: float
    packets: Path | None = None
