"""Stills as the source of a stream: pictures with irregular times."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from av.video.frame import VideoFrame
from numpy.typing import NDArray
from PIL import Image, ImageOps

from pipeline.errors import InputError
from pipeline.ingest.finding import Finding
from pipeline.ingest.sampling import sampled
from pipeline.ingest.source import LostPicture, PassedPicture, Picture, SourceInfo
from pipeline.ingest.video.recordings import even
from pipeline.messages import FloatArray

#: what Pillow says of a file that is cut off, damaged or no picture
_UNREADABLE = (OSError, ValueError, SyntaxError, Image.DecompressionBombError, EOFError)


@dataclass(frozen=True, slots=True)
class _Still:
    index: int
    time_s: float
    path: Path


@dataclass(frozen=True, slots=True, eq=False)
class StillsSource:
    """A Source. files: in the order of their times. times: seconds since the first, float64 (N,), increasing.

    width, height: of the upright pictures; one of another size is lost, since the camera would be wrong.
    Make it with open_stills. JPEG, PNG, TIFF, and of a DNG the preview that its first picture is.
    """

    files: tuple[Path, ...]
    times: FloatArray
    width: int
    height: int
    start_s: float
    end_s: float
    sent_size: tuple[int, int]

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files."""
        return self.files

    @property
    def offsets_s(self) -> list[float]:
        """They all begin at once."""
        return [0.0]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was noticed of the pictures."""
        return ()

    @property
    def times_s(self) -> FloatArray:
        """When the pictures of the used part were taken."""
        return self.times[(self.times >= self.start_s) & (self.times < self.end_s)]

    @property
    def info(self) -> SourceInfo:
        """Its rate is the mean one, and it is not constant."""
        return SourceInfo(
            self.width,
            self.height,
            1.0 / _interval_s(self.times),
            len(self.times_s),
            self.end_s,
            self.start_s,
            constant=False,
        )

    def pictures(self, rate_hz: float) -> Iterator[Picture | LostPicture | PassedPicture]:
        """As Source says; a still is opened if a tick falls between it and the next one."""
        stills = (
            _Still(k, float(t), path)
            for k, (t, path) in enumerate(zip(self.times, self.files, strict=True))
            if self.start_s <= t < self.end_s
        )
        # the last one is shown until the next tick
        for still, tick in sampled(stills, rate_hz, 1e-6, 1.5 / rate_hz):
            if tick is None:
                yield PassedPicture(still.index, still.time_s)
                continue
            try:
                image = self._opened(still.path, self.sent_size)
            except (InputError, *_UNREADABLE) as error:
                reason = "missing" if isinstance(error, FileNotFoundError) else "damaged"
                yield LostPicture(still.index, still.time_s, reason)
                continue
            yield Picture(still.index, still.time_s, tick, _planes(image, self.sent_size))

    def images_at(self, times_s: Iterable[float]) -> Iterator[tuple[float, NDArray[np.uint8]]]:
        """As Source says."""
        yield from self._opened_at(times_s, (self.width, self.height))

    def planes_at(self, times_s: Iterable[float]) -> Iterator[tuple[float, VideoFrame]]:
        """As Source says."""
        for time_s, image in self._opened_at(times_s, self.sent_size):
            yield time_s, _planes(image, self.sent_size)

    def _opened_at(
        self, times_s: Iterable[float], size: tuple[int, int]
    ) -> Iterator[tuple[float, NDArray[np.uint8]]]:
        for time_s in sorted(set(times_s)):
            at = int(np.abs(self.times - time_s).argmin())
            if abs(self.times[at] - time_s) > 1e-6:
                continue
            try:
                yield time_s, self._opened(self.files[at], size)
            except (InputError, *_UNREADABLE):
                continue

    def exact_times_s(self) -> FloatArray:
        """As Source says."""
        return self.times_s

    def resized(self, width: int, height: int) -> StillsSource:
        """As Source says."""
        return replace(self, sent_size=(width, height))

    def _opened(self, path: Path, size: tuple[int, int]) -> NDArray[np.uint8]:
        with Image.open(path) as image:
            if _upright_size(image) != (self.width, self.height):
                raise InputError(path, f"{image.size} pixels", f"{self.width} x {self.height}")
            # a JPEG can be decoded at a half, a quarter or an eighth; the rest of the way is the mean of pixels
            image.draft("RGB", (max(size), max(size)))
            return np.asarray(ImageOps.exif_transpose(_eight_bits(image)).convert("RGB"))


def open_stills(
    files: tuple[Path, ...], times_s: FloatArray, start_s: float | None = None, end_s: float | None = None
) -> StillsSource:
    """Stills as a source. times_s: (N,), seconds, in any order, on any zero; files: (N,), as they.

    Raises InputError if none can be opened, or the part holds none.
    """
    order = np.argsort(times_s, kind="stable")
    times = np.asarray(times_s, np.float64)[order] - float(np.min(times_s)) if len(files) else np.zeros(0)
    ordered = tuple(files[k] for k in order)
    size = next((size for path in ordered if (size := _size(path)) is not None), None)
    if size is None:
        where = ordered[0].parent if ordered else "stills"
        raise InputError(where, "no still that can be opened", "JPEG, PNG or TIFF files")
    whole_s = float(times[-1]) + _interval_s(times)
    part = max(0.0, start_s or 0.0), min(whole_s, whole_s if end_s is None else end_s)
    source = StillsSource(ordered, times, *size, *part, even(*size))
    if not len(source.times_s):
        found = f"start {part[0]:g} s and end {part[1]:g} s"
        raise InputError(ordered[0].parent, found, f"a part of the stills, which last {whole_s:.2f} s")
    return source


def _interval_s(times: FloatArray) -> float:
    span_s = float(times[-1] - times[0])
    return span_s / (len(times) - 1) if span_s > 0.0 else 1.0


def _size(path: Path) -> tuple[int, int] | None:
    try:
        with Image.open(path) as image:
            return _upright_size(image)
    except _UNREADABLE:
        return None


def _upright_size(image: Image.Image) -> tuple[int, int]:
    """EXIF orientations of 5 and more lie on their side."""
    return image.size[::-1] if image.getexif().get(0x0112, 1) >= 5 else image.size


def _eight_bits(image: Image.Image) -> Image.Image:
    """16-bit gray (thermal, TIFF and PNG) stretched over its own range, or Pillow would cut it at 255."""
    if not image.mode.startswith(("I", "F")):
        return image
    values = np.asarray(image, np.float64)
    low, high = np.percentile(values, (0.5, 99.5))
    stretched = np.clip((values - low) / max(high - low, 1e-9), 0.0, 1.0)
    result = Image.fromarray((255.0 * stretched).astype(np.uint8))
    result.getexif()[0x0112] = image.getexif().get(0x0112, 1)
    return result


def _planes(image: NDArray[np.uint8], size: tuple[int, int]) -> VideoFrame:
    frame = VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
    return frame.reformat(*size, format="yuv420p", interpolation="AREA", dst_color_range=1)
