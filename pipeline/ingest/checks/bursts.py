"""Pairs of pictures a moment apart, spread over a video, for as few decoded pictures as that takes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np
from av.container import InputContainer
from av.video.stream import VideoStream
from numpy.typing import NDArray

from pipeline.messages import FloatArray

Gray = NDArray[np.float32]
#: a key picture that is so little later than the last decoded one is reached by decoding on, seconds
_NEAR_S = 0.1


@dataclass(frozen=True)
class BurstParams:
    """width_px: of the pictures. apart_s: between the first and the last of a burst: a gimbal's trembling does not grow
    with it, the way flown does; less_apart_s: where that costs too much, or shows too little of the same ground.

    least, most: bursts, over the video. most_pixels: that may be decoded for more bursts than the least.
    """

    width_px: int = 480
    apart_s: float = 0.5
    less_apart_s: float = 0.25
    least: int = 8
    most: int = 32
    most_pixels: float = 1.2e9


@dataclass(frozen=True, slots=True, eq=False)
class Burst:
    """times_s: of the video, increasing, of gray pictures of the same size; two or three."""

    times_s: tuple[float, ...]
    pictures: tuple[Gray, ...]


def bursts_of(
    path: Path, duration_s: float, size: tuple[int, int] | None, params: BurstParams, threads: int = 1
) -> Iterator[tuple[Burst, float]]:
    """Bursts and the full-size pixels per pixel of theirs; none of a video that cannot be decoded.

    size: width and height of the upright picture; no burst either of a video that is filmed lying or with oblong
    pixels, whose coded size is another one. threads: that decode.
    """
    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            codec = stream.codec_context
            codec.thread_count = threads
            if threads > 1:
                codec.thread_type = "AUTO"
            codec.skip_frame = "NONREF"  # no other picture needs them, so neither do we
            scale = max(1.0, codec.width / params.width_px)
            compared = (round(codec.width / scale), round(codec.height / scale))
            if scale >= 2.0:
                codec.options = {"skip_loop_filter": "all"}  # edges of blocks that nobody sees so small
            if size in (None, (codec.width, codec.height)):
                for burst in _Reader(container, stream, compared, params).bursts(duration_s):
                    yield burst, scale
    except (av.FFmpegError, OSError, IndexError):
        return  # what a video cannot show, other checks say


def moments_of(
    keys_s: FloatArray, duration_s: float, rate_hz: float, pixels: int, apart_s: float, params: BurstParams
) -> FloatArray:
    """When bursts of ``apart_s`` should begin: as many as ``most_pixels`` allows, evenly over the video.

    keys_s: times of the pictures that stand alone; empty where they are not known. A burst begins at the key
    picture before its moment. Where the burst before has begun there too, it begins at its moment, and all from that
    burst on is decoded; where even ``least`` bursts cost too much that way, there is one for each key picture only.
    """
    last_s = duration_s - apart_s - 2.0 / rate_hz
    if last_s <= 0.0:
        return np.zeros(0)
    for count in range(params.most, params.least - 1, -1):
        moments_s = np.linspace(0.0, last_s, count)
        if _decoded(moments_s, keys_s, rate_hz, apart_s) * pixels <= params.most_pixels:
            return moments_s
    moments_s = np.linspace(0.0, last_s, params.least)
    if not len(keys_s):
        return moments_s
    begun = np.searchsorted(keys_s, moments_s, side="right")
    return moments_s[np.unique(begun, return_index=True)[1]]


def apart_s_of(rate_hz: float, pixels: int, params: BurstParams) -> float:
    """Seconds that a burst of such pictures may take."""
    fits = params.least * (2.0 + rate_hz * params.apart_s) * pixels <= params.most_pixels
    return params.apart_s if fits else params.less_apart_s


def _decoded(moments_s: FloatArray, keys_s: FloatArray, rate_hz: float, apart_s: float) -> float:
    """How many pictures these bursts cost."""
    burst = 2.0 + rate_hz * apart_s
    if not len(keys_s):
        return burst * len(moments_s)
    key = np.searchsorted(keys_s, moments_s, side="right")
    same = np.diff(key) == 0
    return burst * (len(moments_s) - same.sum()) + rate_hz * float(np.diff(moments_s)[same].sum())


class _Reader:
    """Decodes on where the next moment is near, and seeks where a key picture lies between."""

    def __init__(
        self, container: InputContainer, stream: VideoStream, size: tuple[int, int], params: BurstParams
    ) -> None:
        self._container, self._stream, self._size, self._params = container, stream, size, params
        self._base = float(stream.time_base or 1)
        self._start = stream.start_time or 0
        self._frames: Iterator[tuple[float, av.VideoFrame]] = iter(())
        self._at_s = -np.inf

    def bursts(self, duration_s: float) -> Iterator[Burst]:
        codec, keys_s = self._stream.codec_context, self._key_times_s()
        rate_hz, pixels = float(self._stream.average_rate or 30), codec.width * codec.height
        apart_s = apart_s_of(rate_hz, pixels, self._params)
        for begin_s in moments_of(keys_s, duration_s, rate_hz, pixels, apart_s, self._params).tolist():
            first = self._first(begin_s, keys_s)
            burst = None if first is None else self._burst(first, apart_s)
            if burst is not None:
                yield burst

    def _first(self, begin_s: float, keys_s: FloatArray) -> tuple[float, av.VideoFrame] | None:
        before = keys_s[keys_s <= begin_s]
        if len(before) and before[-1] <= self._at_s + _NEAR_S:
            return next((f for f in self._frames if f[0] >= begin_s), None)
        self._container.seek(self._start + int(begin_s / self._base), stream=self._stream, backward=True)
        self._frames = _timed(self._container, self._stream, self._start, self._base)
        first = next(self._frames, None)
        # the burst before may have begun here too
        return None if first is None or first[0] <= self._at_s else first

    def _burst(self, first: tuple[float, av.VideoFrame], apart_s: float) -> Burst | None:
        times_s, pictures = [first[0]], [self._gray(first[1])]
        for least_s in sorted({self._params.less_apart_s, apart_s}):
            shown = next((f for f in self._frames if f[0] - first[0] >= least_s - 1e-6), None)
            if shown is None:
                return None
            times_s.append(shown[0])
            pictures.append(self._gray(shown[1]))
        self._at_s = times_s[-1]
        return Burst(tuple(times_s), tuple(pictures))

    def _key_times_s(self) -> FloatArray:
        """By an index that is whole: times of decoding, not later than those of showing. Empty without one."""
        if not self._container.format.name.startswith("mov"):
            return np.zeros(0)
        ticks = [e.timestamp for e in self._stream.index_entries if e.is_keyframe and not e.is_discard]
        return (np.sort(np.array(ticks, np.float64)) - self._start) * self._base

    def _gray(self, frame: av.VideoFrame) -> Gray:
        picture = frame.reformat(width=self._size[0], height=self._size[1], format="gray")
        return np.asarray(picture.to_ndarray(), dtype=np.float32)


def _timed(
    container: InputContainer, stream: VideoStream, start: int, base: float
) -> Iterator[tuple[float, av.VideoFrame]]:
    for frame in container.decode(stream):
        if frame.pts is not None:
            yield (frame.pts - start) * base, frame
