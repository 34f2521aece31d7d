"""Where the pictures of a stream come from: an iterator whose end need not be known."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, cast

import numpy as np
from av.video.frame import VideoFrame
from numpy.typing import NDArray

from pipeline.messages import FloatArray


@dataclass(frozen=True, slots=True)
class SourceInfo:
    """width, height: of the upright picture with square pixels. frame_rate: Hz, the usual one; stills: mean.

    pictures, duration_s: None where the end is not known (a live stream); duration_s is the time of the end, of
    the part that is used. start_s: where that part begins. constant: whether the pictures keep the frame rate.
    """

    width: int
    height: int
    frame_rate: float
    pictures: int | None
    duration_s: float | None
    start_s: float = 0.0
    constant: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """index: number in the stream, from 0, damaged ones counted. time_s: presentation time since its start.

    tick: of the processing clock, for which it is taken. planes: upright, square pixels, yuv420p, at an even size
    that may be smaller than the stream's (``sent_size``).
    """

    index: int
    time_s: float
    tick: int
    planes: VideoFrame

    @property
    def image(self) -> NDArray[np.uint8]:
        """uint8 (H, W, 3) RGB, made at each call."""
        return cast("NDArray[np.uint8]", self.planes.to_ndarray(format="rgb24"))


@dataclass(frozen=True, slots=True)
class LostPicture:
    """A picture that could not be had, and why: ``damaged``, ``missing``."""

    index: int
    time_s: float
    reason: str


@dataclass(frozen=True, slots=True)
class PassedPicture:
    """A picture that no tick of the processing clock falls on."""

    index: int
    time_s: float


@dataclass(frozen=True, slots=True)
class NothingYet:
    """Of a live stream: no picture has come for a moment."""


class Source(Protocol):
    """A file, several in a row, a folder of stills, or a live stream."""

    @property
    def info(self) -> SourceInfo:
        """What is known of it before the first picture."""

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files it is read from; none of a live stream."""

    @property
    def times_s(self) -> FloatArray:
        """When its pictures are shown, float64 (N,), as far as the files' indices know; none of a live stream."""

    @property
    def sent_size(self) -> tuple[int, int]:
        """Width and height of the planes that it gives: even, pixels."""

    def pictures(self, rate_hz: float) -> Iterator[Picture | LostPicture | PassedPicture | NothingYet]:
        """Every picture once, in order: given if it is the one at or just before a tick k / rate_hz, once each.

        A live stream says now and then that there is nothing yet.
        """

    def images_at(self, times_s: Iterable[float]) -> Iterator[tuple[float, NDArray[np.uint8]]]:
        """For times of pictures: the time and the picture, uint8 (H, W, 3) RGB in full size; lost ones are left out."""

    def planes_at(self, times_s: Iterable[float]) -> Iterator[tuple[float, VideoFrame]]:
        """For times of pictures: the time and the planes, as ``pictures`` gives them; lost ones are left out."""

    def resized(self, width: int, height: int) -> Source:
        """The same pictures, their planes at another size: even, at most the picture's."""

    def exact_times_s(self) -> FloatArray:
        """As times_s, exact, of every picture; may read all files."""
