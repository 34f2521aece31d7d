"""How the ground moves through the pictures of a video: displacements of patches between pictures of short bursts.

Patches are matched by phase correlation (C. D. Kuglin, D. C. Hines, "The phase correlation image alignment method",
Proc. IEEE Conf. Cybernetics and Society, 1975), first the whole picture, then each patch about its displacement.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np
from av.video.stream import VideoStream
from numpy.typing import NDArray

from pipeline.messages import FloatArray

Gray = NDArray[np.float32]


@dataclass(frozen=True)
class MotionParams:
    """width_px: of the pictures that are compared. patch_px: side of a patch. columns, rows: of patches.

    burst_s: between the two pictures of a burst. least_bursts, most_bursts: over the video; as many as most_pixels
    decoded pixels allow. least_peak: of a correlation, standard deviations above its mean, below which a patch has
    not been found again (water, sky, a picture without texture).
    """

    width_px: int = 480
    patch_px: int = 64
    columns: int = 5
    rows: int = 3
    burst_s: float = 0.25
    least_bursts: int = 8
    most_bursts: int = 32
    most_pixels: float = 1.2e9
    least_peak: float = 9.0


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """M patches that were found again. first_s, second_s: (M,), time of the video of both pictures.

    from_px, to_px: (M, 2), the patch's middle in both, in pixels of the full-size picture. burst: (M,), its number.
    scale: full-size pixels per pixel that was compared. bursts: how many there were, with or without patches.
    """

    first_s: FloatArray
    second_s: FloatArray
    from_px: FloatArray
    to_px: FloatArray
    burst: NDArray[np.int64]
    scale: float
    bursts: int

    @property
    def displacement_px(self) -> FloatArray:
        """(M, 2), in pixels that were compared."""
        return (self.to_px - self.from_px) / self.scale


def picture_motion(
    path: Path, duration_s: float, size: tuple[int, int] | None = None, params: MotionParams | None = None
) -> Motion:
    """The motion in a video, at moments spread over it. Nothing (M = 0) for a video that cannot be decoded.

    size: width and height of the upright picture; nothing either for a video that is filmed lying or with oblong
    pixels, whose coded size is another one.
    """
    params = params or MotionParams()
    rows: list[tuple[float, float, FloatArray, FloatArray, int]] = []
    scale, bursts = 1.0, 0
    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            stream.codec_context.thread_count = 2
            width, height = stream.codec_context.width, stream.codec_context.height
            scale = max(1.0, width / params.width_px)
            compared = (round(width / scale), round(height / scale))
            moments = _moments(stream, duration_s, params) if size in (None, (width, height)) else np.zeros(0)
            for number, begin_s in enumerate(moments):
                pair = _pair(container, stream, begin_s, params.burst_s, compared)
                if pair is None:
                    continue
                bursts += 1
                first_s, second_s, first, second = pair
                for start, end in matched(first, second, params):
                    rows.append((first_s, second_s, start * scale, end * scale, number))
    except (av.FFmpegError, OSError, IndexError):
        pass  # what a video cannot show, other checks say
    firsts, seconds, start_px, end_px, burst = zip(*rows, strict=True) if rows else ((), (), (), (), ())
    return Motion(
        np.array(firsts, np.float64),
        np.array(seconds, np.float64),
        np.array(start_px, np.float64).reshape(-1, 2),
        np.array(end_px, np.float64).reshape(-1, 2),
        np.array(burst, np.int64),
        scale,
        bursts,
    )


def matched(first: Gray, second: Gray, params: MotionParams) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Middles of the patches of one picture, and where they are in another, pixels (x, y)."""
    whole, _ = _shift(first, second)
    half = params.patch_px // 2
    height, width = first.shape
    for y in np.linspace(half, height - half, params.rows).astype(int):
        for x in np.linspace(half, width - half, params.columns).astype(int):
            to_x, to_y = x + round(whole[0]), y + round(whole[1])
            if not (half <= to_x <= width - half and half <= to_y <= height - half):
                continue
            a = first[y - half : y + half, x - half : x + half]
            b = second[to_y - half : to_y + half, to_x - half : to_x + half]
            moved, peak = _shift(a, b)
            if peak >= params.least_peak and np.abs(moved).max() < 0.35 * params.patch_px:
                start = np.array([x, y], dtype=np.float64)
                yield start, np.array([to_x, to_y]) + moved


def _shift(first: Gray, second: Gray) -> tuple[FloatArray, float]:
    """How far (x, y) the second picture's contents are from the first's, and how clear that is."""
    window = np.outer(np.hanning(first.shape[0]), np.hanning(first.shape[1])).astype(np.float32)
    a, b = (np.fft.rfft2((picture - picture.mean()) * window) for picture in (first, second))
    cross = np.conj(a) * b
    cross /= np.maximum(np.abs(cross), 1e-6)
    surface = np.fft.irfft2(cross, s=first.shape)
    y, x = np.unravel_index(int(np.argmax(surface)), surface.shape)
    peak = float((surface[y, x] - surface.mean()) / (surface.std() + 1e-9))
    shift = [_refined(surface[y, :], int(x)), _refined(surface[:, x], int(y))]
    return np.array(shift), peak


def _refined(line: FloatArray, at: int) -> float:
    """The place of a peak, by a parabola through it and its neighbours; beyond the middle it is negative."""
    n = len(line)
    left, middle, right = line[(at - 1) % n], line[at], line[(at + 1) % n]
    bend = left - 2.0 * middle + right
    offset = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    place = at + float(np.clip(offset, -0.5, 0.5))
    return place - n if place > n / 2 else place


def _moments(stream: VideoStream, duration_s: float, params: MotionParams) -> FloatArray:
    pixels = stream.codec_context.width * stream.codec_context.height
    rate = float(stream.average_rate or 30)
    per_burst = pixels * (2.0 + rate * params.burst_s)
    count = int(np.clip(params.most_pixels / max(per_burst, 1.0), params.least_bursts, params.most_bursts))
    last_s = max(0.0, duration_s - params.burst_s - 2.0 / rate)
    return np.linspace(0.0, last_s, count) if last_s > 0.0 else np.zeros(0)


def _pair(
    container: av.container.InputContainer,
    stream: VideoStream,
    begin_s: float,
    apart_s: float,
    size: tuple[int, int],
) -> tuple[float, float, Gray, Gray] | None:
    """Two pictures from the key picture before a moment on, gray, and their times; None where there are none."""
    base = stream.time_base
    if base is None:
        return None
    start = stream.start_time or 0
    container.seek(start + int(begin_s / base), stream=stream, backward=True)
    first: tuple[float, Gray] | None = None
    for frame in container.decode(stream):
        if frame.pts is None:
            continue
        time_s = float((frame.pts - start) * base)
        if first is None:
            first = time_s, _gray(frame, size)
        elif time_s - first[0] >= apart_s - 1e-6:
            return first[0], time_s, first[1], _gray(frame, size)
    return None


def _gray(frame: av.VideoFrame, size: tuple[int, int]) -> Gray:
    picture = frame.reformat(width=size[0], height=size[1], format="gray")
    return np.asarray(picture.to_ndarray(), dtype=np.float32)
