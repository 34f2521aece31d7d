"""Video files: what they promise, whether they hold it, and their pictures."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import av
import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.stream import VideoStream
from numpy.typing import NDArray

from pipeline.errors import InputError

# Only containers of recordings: FFmpeg would also take a playlist, and fetch what it names. Edit lists hide
# pictures that the container counts; without them, picture i is packet i.
_OPTIONS = {
    "format_whitelist": "mov,matroska,webm,avi,mpegts",
    "protocol_whitelist": "file",
    "ignore_editlist": "1",
}
_EXPECTED = "a whole MP4, MOV, MKV, AVI or TS video"
_WHOLE = "a video that is neither truncated nor damaged"


@dataclass(frozen=True, slots=True)
class VideoInfo:
    """What a video file holds. width, height: pixels. frame_rate: Hz. codec: FFmpeg's name, e.g. ``h264``."""

    path: Path
    width: int
    height: int
    frame_rate: float
    frames: int
    duration_s: float
    codec: str


def open_video(path: Path) -> VideoInfo:
    """What the container promises; its pictures are not read (see check_video).

    Raises InputError for a missing, empty, truncated or non-video file.
    """
    with _opened(path) as (container, stream):
        if not stream.average_rate:
            raise InputError(path, "a video without a frame rate", _EXPECTED)
        rate = float(stream.average_rate)
        frames = stream.frames or sum(1 for packet in container.demux(stream) if packet.size)
        if frames == 0:
            raise InputError(path, "a video without a picture", _EXPECTED)
        codec = stream.codec_context
        return VideoInfo(path, codec.width, codec.height, rate, frames, frames / rate, codec.name)


def check_video(path: Path, thorough: bool = False) -> VideoInfo:
    """Compare the packets in the file with what its container promises; decode them only if thorough.

    Raises InputError if some are missing or cut off, and, if thorough, for the first one that is damaged.
    """
    info = open_video(path)
    with _opened(path) as (container, stream):
        whole, last_s = 0, 0.0
        for packet in container.demux(stream):
            if packet.size and not packet.is_corrupt:
                whole += 1
                last_s = max(last_s, _seconds(packet.pts, stream))
        promised_s = (container.duration or 0) / av.time_base
    missing_s = 0.0 if stream.frames else promised_s - last_s - 1.0 / info.frame_rate
    if whole < info.frames or missing_s > 1.0:
        promised = max(info.frames, round(promised_s * info.frame_rate))
        raise InputError(path, f"{whole} whole pictures of {promised} promised", _WHOLE)
    if thorough:
        for _ in read_frames(path, ()):
            pass
    return info


def read_frames(
    path: Path, indices: Collection[int] | Callable[[int], bool] | None = None
) -> Iterator[tuple[int, float, NDArray[np.uint8]]]:
    """Index, time since the first picture (s) and RGB image, uint8 (H, W, 3), of the wanted pictures.

    indices: the wanted numbers, or a test of a number; None: all. Every picture is decoded, in order, and the
    wanted ones are converted to RGB. Raises InputError with the number of the first picture that is damaged.
    """
    wanted = _test_of(indices)
    with _opened(path) as (container, stream):
        first: float | None = None
        for index, frame in enumerate(_decoded(path, container, stream)):
            time_s = _seconds(frame.pts, stream)
            first = time_s if first is None else first
            if wanted(index):
                yield index, time_s - first, cast("NDArray[np.uint8]", frame.to_ndarray(format="rgb24"))


def decoded_frames(path: Path) -> Iterator[VideoFrame]:
    """Every picture as FFmpeg's own frame, pixels not converted; errors as in read_frames."""
    with _opened(path) as (container, stream):
        yield from _decoded(path, container, stream)


def picture_times_s(path: Path) -> NDArray[np.float64]:
    """Presentation time of every picture since the first one, seconds, increasing; nothing is decoded."""
    with _opened(path) as (container, stream):
        times = sorted(_seconds(packet.pts, stream) for packet in container.demux(stream) if packet.size)
    return np.array(times, np.float64) - (times[0] if times else 0.0)


def sampled_indices(
    frames: int, video_rate_hz: float, processing_rate_hz: float, where: object = "processing.frame_rate"
) -> NDArray[np.int64]:
    """Number of the picture at or just before each tick k / processing_rate; int64 (K,), k = 0, 1, ..

    Strictly increasing. Raises InputError if the processing is faster than the video.
    """
    if processing_rate_hz > video_rate_hz * (1.0 + 1e-9):
        raise InputError(where, f"{processing_rate_hz:g} Hz", f"at most the video's {video_rate_hz:g} Hz")
    step = max(video_rate_hz / processing_rate_hz, 1.0)
    # 1e-6 of a picture: a tick that falls on a picture must not be rounded to the one before
    indices = np.floor(np.arange(int(frames / step) + 2) * step + 1e-6).astype(np.int64)
    return indices[indices < frames]


def _test_of(indices: Collection[int] | Callable[[int], bool] | None) -> Callable[[int], bool]:
    if indices is None:
        return lambda _: True
    return indices if callable(indices) else frozenset(int(i) for i in indices).__contains__


def _decoded(path: Path, container: InputContainer, stream: VideoStream) -> Iterator[VideoFrame]:
    index = 0
    try:
        for packet in container.demux(stream):
            for frame in packet.decode():
                if frame.is_corrupt:
                    raise InputError(f"{path} frame {index}", "a damaged picture", _WHOLE)
                yield frame
                index += 1
    except av.FFmpegError as error:
        raise InputError(f"{path} frame {index}", f"a damaged picture ({error.strerror})", _WHOLE) from None
    if index < stream.frames:
        raise InputError(path, f"{index} whole pictures of {stream.frames} promised", _WHOLE)


@contextmanager
def _opened(path: Path) -> Iterator[tuple[InputContainer, VideoStream]]:
    if not path.is_file():
        raise InputError(path, "no file", _EXPECTED)
    if path.stat().st_size == 0:
        raise InputError(path, "an empty file", _EXPECTED)
    try:
        container = av.open(str(path), options=_OPTIONS)
    except (av.FFmpegError, OSError) as error:
        raise InputError(path, f"a file that cannot be opened ({error.strerror})", _EXPECTED) from None
    with container:
        stream = container.streams.best("video")
        if not isinstance(stream, VideoStream):
            raise InputError(path, "no video in the file", _EXPECTED)
        # one thread per stream: the streams of a mission already run beside each other
        stream.codec_context.thread_count = 1
        try:
            yield container, stream
        except av.FFmpegError as error:
            raise InputError(path, f"a file that cannot be read ({error.strerror})", _EXPECTED) from None


def _seconds(pts: int | None, stream: VideoStream) -> float:
    return 0.0 if pts is None or stream.time_base is None else float(pts * stream.time_base)
