"""Where the pictures of a stream come from: an iterator whose end need not be known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class SourceInfo:
    """width, height: of the upright picture with square pixels. frame_rate: Hz, the usual one; stills: mean.

    pictures, duration_s: None where the end is not known (a live stream).
    """

    width: int
    height: int
    frame_rate: float
    pictures: int | None
    duration_s: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """index: number in the stream, from 0, damaged ones counted. time_s: presentation time since its start.

    image: uint8 (H, W, 3) RGB, upright.
    """

    index: int
    time_s: float
    image: NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class LostPicture:
    """A picture that could not be had, and why: ``damaged``, ``missing``."""

    index: int
    time_s: float
    reason: str


class Source(Protocol):
    """A file, several in a row, a folder of stills, or a live stream."""

    @property
    def info(self) -> SourceInfo:
        """What is known of it before the first picture."""

    def pictures(self, rate_hz: float) -> Iterator[Picture | LostPicture]:
        """The picture at or just before each tick k / rate_hz of the presentation time, once each, in order."""
