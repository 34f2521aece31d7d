"""Keeps a live stream as it comes, so that its pictures can be seen again: segments, and when each was taken."""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.container import OutputContainer
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.ingest.video.container import opened
from pipeline.ingest.video.decode import shown_frames
from pipeline.ingest.video.upright import upright_of
from pipeline.logs import Log
from pipeline.storage.whole_or_nothing import make_folder

_LOG = Log("ingest")
#: a segment is so long, and on to the next picture that stands alone: what must be decoded to see one picture, seconds
_SEGMENT_S = 20.0
#: time of the stream, presentation time (seconds), number of the segment
_ROW = struct.Struct("<ddI")
#: a transport stream counts so far, seconds; pictures that are so near are one
_WRAP_S, _SAME_S = 2**33 / 90_000, 1e-3


@dataclass
class Recorder:
    """folder: made when the first picture comes. incarnation: of the process that reads the stream."""

    folder: Path
    incarnation: int = 0
    _stream: VideoStream | None = None
    _out: OutputContainer | None = None
    _own: Any = None
    _number: int = -1
    _until_s: float = 0.0
    _index: Any = field(default=None, repr=False)

    def begin(self, stream: VideoStream) -> None:
        """Packets that follow are of another connection."""
        self.end()
        self._stream, self._until_s = stream, 0.0

    def keep(self, packet: Packet[VideoStream], arrival_s: float) -> None:
        """A packet as it came, from the first that stands alone on. A disk that does not take it ends the recording."""
        if self._stream is None or packet.pts is None or packet.dts is None:
            return
        try:
            if packet.is_keyframe and arrival_s >= self._until_s:
                self._next(arrival_s)
            if self._out is not None:
                self._put(packet)
        except (av.FFmpegError, OSError, ValueError) as error:
            _LOG.warning("recording stopped", folder=self.folder, error=f"{type(error).__name__}: {error}")
            self._stream = None
            self.end()

    def _put(self, packet: Packet[VideoStream]) -> None:
        """A copy: the decoder needs the packet as it is."""
        copy = av.Packet(bytes(packet))
        copy.pts, copy.dts, copy.time_base = packet.pts, packet.dts, packet.time_base
        copy.is_keyframe, copy.stream = packet.is_keyframe, self._own
        assert self._out is not None
        self._out.mux(copy)

    def _next(self, arrival_s: float) -> None:
        self.end()
        make_folder(self.folder)
        self._number += 1
        self._until_s = arrival_s + _SEGMENT_S
        path = self.folder / _segment(self.incarnation, self._number)
        self._out = av.open(str(path), "w", format="mpegts", options={"flush_packets": "1"})
        assert self._stream is not None
        self._own = self._out.add_stream_from_template(self._stream)
        if self._index is None:
            self._index = (self.folder / f"{self.incarnation}.index").open("ab", buffering=0)

    def taken(self, time_s: float, shown_s: float) -> None:
        """A picture of the segment that is written: when it was taken, and its presentation time."""
        if self._out is not None and self._index is not None:
            with suppress(OSError):
                self._index.write(_ROW.pack(time_s, shown_s, self._number))

    def end(self) -> None:
        """Close the segment."""
        if self._out is not None:
            with suppress(av.FFmpegError, OSError, ValueError):
                self._out.close()
        self._out = None


def _segment(incarnation: int, number: int) -> str:
    return f"{incarnation}-{number:05}.ts"


def recorded_images(
    folder: Path, times_s: Iterable[float], size: tuple[int, int]
) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """Of times at which pictures were taken: the time and the picture, uint8 (H, W, 3) RGB, upright, scaled to a size.

    What is not there, or cannot be decoded any more, is left out.
    """
    wanted: dict[Path, list[tuple[float, float]]] = defaultdict(list)
    rows = list(_rows(folder))
    known = np.array([time_s for time_s, _, _ in rows])
    for time_s in sorted(set(times_s)) if rows else ():
        nearest = int(np.abs(known - time_s).argmin())
        if abs(known[nearest] - time_s) <= _SAME_S:
            wanted[rows[nearest][2]].append((time_s, rows[nearest][1]))
    for path, moments in sorted(wanted.items()):
        with suppress(InputError, av.FFmpegError, OSError):  # nothing of it was written, or it was removed
            yield from _in_segment(path, moments, size)


def _rows(folder: Path) -> Iterator[tuple[float, float, Path]]:
    for index in sorted(folder.glob("*.index")):
        data = index.read_bytes()
        for time_s, shown_s, number in _ROW.iter_unpack(data[: len(data) - len(data) % _ROW.size]):
            yield time_s, shown_s, folder / _segment(int(index.stem), number)


def _in_segment(
    path: Path, moments: list[tuple[float, float]], size: tuple[int, int]
) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    with opened(path) as (container, stream):
        for ticks, frame in shown_frames(container, stream):
            shown_s = float(ticks * stream.time_base) if stream.time_base else 0.0
            for time_s, wanted_s in moments:
                if abs((shown_s - wanted_s + _WRAP_S / 2) % _WRAP_S - _WRAP_S / 2) <= _SAME_S and isinstance(
                    frame, VideoFrame
                ):
                    yield time_s, _scaled(upright_of(frame, stream.sample_aspect_ratio).rgb(frame), size)


def _scaled(image: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    if (image.shape[1], image.shape[0]) == size:
        return image
    frame = VideoFrame.from_ndarray(image, format="rgb24").reformat(*size, interpolation="AREA")
    return np.ascontiguousarray(frame.to_ndarray())
