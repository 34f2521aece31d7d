"""From a frame as it is coded to the picture that a person would see: upright, with square pixels, 8 bits."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import cast

import numpy as np
from av.video.frame import VideoFrame
from numpy.typing import NDArray

#: pixel aspects beyond this are a writer's fault, not a lens
_MAX_ASPECT = 4
#: FFmpeg's numbers: colour range of 16..235, transfer of HDR10 (SMPTE ST 2084, PQ) and of HLG
_LIMITED, PQ, HLG = 1, 16, 18


@dataclass(frozen=True, slots=True)
class Upright:
    """How coded frames become upright: first transposed, then mirrored.

    width, height: coded, pixels. aspect: width of a pixel over its height. mirror_x: left and right change places.
    """

    width: int
    height: int
    aspect: Fraction = Fraction(1)
    transpose: bool = False
    mirror_x: bool = False
    mirror_y: bool = False

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the upright picture with square pixels."""
        square = max(1, round(self.width * self.aspect)), self.height
        return square[::-1] if self.transpose else square

    @property
    def is_turned(self) -> bool:
        """Whether pixels change their places."""
        return self.transpose or self.mirror_x or self.mirror_y

    def planes(self, frame: VideoFrame, width: int, height: int) -> VideoFrame:
        """The upright picture in yuv420p, limited range, at an even size; the colour matrix stays the frame's."""
        inner = (height, width) if self.transpose else (width, height)
        same = frame.format.name == "yuv420p" and (frame.width, frame.height) == inner and not _is_full(frame)
        scaled = frame if same else _reformatted(frame, *inner)
        if not self.is_turned:
            return scaled
        planes = cast("NDArray[np.uint8]", scaled.to_ndarray())
        (w, h), luma = inner, planes[: inner[1]]
        chroma = planes[h:].reshape(2, h // 2, w // 2)
        turned = np.concatenate([self._turned(p).ravel() for p in (luma, *chroma)])
        result = VideoFrame.from_ndarray(turned.reshape(-1, width), format="yuv420p")
        result.colorspace, result.color_range = scaled.colorspace, scaled.color_range
        return result

    def rgb(self, frame: VideoFrame) -> NDArray[np.uint8]:
        """The upright picture in full size, uint8 (H, W, 3) RGB."""
        width, height = self.size
        inner = (height, width) if self.transpose else (width, height)
        image = cast("NDArray[np.uint8]", frame.reformat(*inner, format="rgb24").to_ndarray())
        return np.ascontiguousarray(self._turned(image))

    def _turned(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        image = image.swapaxes(0, 1) if self.transpose else image
        return image[:: -1 if self.mirror_y else 1, :: -1 if self.mirror_x else 1]


def upright_of(frame: VideoFrame, aspect: Fraction | None) -> Upright:
    """From the first frame of a file: its size and display matrix. aspect: of its pixels, as the container says."""
    known = aspect if aspect and Fraction(1, _MAX_ASPECT) <= aspect <= _MAX_ASPECT else Fraction(1)
    a, b, c, d = _matrix(frame)
    if abs(a) + abs(d) >= abs(b) + abs(c):
        return Upright(frame.width, frame.height, known, False, a < 0, d < 0)
    return Upright(frame.width, frame.height, known, True, c < 0, b < 0)


def _matrix(frame: VideoFrame) -> tuple[int, int, int, int]:
    """x' = a x + c y, y' = b x + d y, in units of 1/65536 (ISO/IEC 14496-12, tkhd)."""
    data = next((one for one in frame.side_data if one.type.name == "DISPLAYMATRIX"), None)  # type: ignore[attr-defined]
    if data is None:
        return 65536, 0, 0, 65536
    m = np.frombuffer(cast("bytes", data), np.int32)
    return int(m[0]), int(m[1]), int(m[3]), int(m[4])


def _is_full(frame: VideoFrame) -> bool:
    return int(frame.color_range) == 2 or frame.format.name.startswith("yuvj")


def _reformatted(frame: VideoFrame, width: int, height: int) -> VideoFrame:
    """Scaled by the mean over each pixel, in one pass."""
    return frame.reformat(
        width, height, format="yuv420p", interpolation="AREA", dst_color_range=_LIMITED, threads=1
    )
