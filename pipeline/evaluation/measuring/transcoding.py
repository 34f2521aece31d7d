"""The pictures of units as detectors see them: each source frame is decoded once for all units that share it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, nullcontext

import av
from av.video.frame import VideoFrame

from pipeline.errors import InputError
from pipeline.evaluation.measuring.meter import Meter
from pipeline.evaluation.measuring.packet_file import read_packets, writing_packets
from pipeline.evaluation.measuring.unit import Unit
from pipeline.ingest.video.file import decoded_frames
from pipeline.link.codec import Decoder, Encoder

_ENCODED_FORMAT = "yuv420p"


def looked_at(units: tuple[Unit, ...], meters: list[Meter]) -> Iterator[tuple[int, VideoFrame, int]]:
    """Which unit, the frame to look at as it comes out of the decoder, the number of its picture.

    units: of one sequence, and alike in which of its frames they take and in what size. Those whose encoded
    stream is kept need no source. Raises InputError for files that cannot be read or encoded.
    """
    fresh = []
    for k, (unit, meter) in enumerate(zip(units, meters, strict=True)):
        if unit.packets is not None and unit.packets.is_file():
            yield from ((k, frame, picture) for frame, picture in _from_packets(unit, meter))
        else:
            fresh.append(k)
    if fresh:
        yield from _from_source({k: (units[k], meters[k]) for k in fresh})


def _from_packets(unit: Unit, meter: Meter) -> Iterator[tuple[VideoFrame, int]]:
    assert unit.condition.codec is not None
    assert unit.packets is not None
    decoder, packets = Decoder(unit.condition.codec), read_packets(unit.packets)
    for index in unit.kept:
        with meter.spending("read"):
            data = next(packets, None)
        if data is None:
            raise InputError(unit.packets, "a stream that is cut off", "a whole one; remove the file")
        meter.count(data)
        with meter.spending("decode"):
            frame = decoder.decode_frame(data)
        if index in unit.looked:
            yield frame, unit.looked[index]


def _from_source(fresh: dict[int, tuple[Unit, Meter]]) -> Iterator[tuple[int, VideoFrame, int]]:
    """Every source frame goes through every unit before the next is decoded."""
    (first, _), *_ = fresh.values()
    shared = Meter()
    with ExitStack() as files:
        lines = {
            k: _Line(unit, meter, files.enter_context(_writer(unit))) for k, (unit, meter) in fresh.items()
        }
        for number, (index, frame) in enumerate(_source(first, shared)):
            scaled = _Scaled(frame, first.size, shared)
            for k, line in lines.items():
                seen = line.through(scaled, number, index)
                if seen is not None:
                    yield k, seen, line.unit.looked[index]
    for _, meter in fresh.values():
        for part, seconds in shared.seconds.items():
            meter.spend(part, seconds / len(fresh))


def _writer(unit: Unit) -> AbstractContextManager[Callable[[bytes], object] | None]:
    return nullcontext(None) if unit.packets is None else writing_packets(unit.packets)


class _Scaled:
    """One source frame in the wanted size; each pixel format is made once."""

    def __init__(self, frame: VideoFrame, size: tuple[int, int] | None, meter: Meter) -> None:
        self._frame, self._size = frame, size or (frame.width, frame.height)
        self._meter, self._made = meter, dict[str, VideoFrame]()

    def as_it_is(self) -> VideoFrame:
        return self._in(self._frame.format.name)

    def to_encode(self) -> VideoFrame:
        return self._in(_ENCODED_FORMAT)

    def _in(self, pixels: str) -> VideoFrame:
        if pixels not in self._made:
            with self._meter.spending("source"):
                self._made[pixels] = self._frame.reformat(*self._size, pixels, interpolation="AREA")
        return self._made[pixels]


class _Line:
    """What a unit makes of frames: encoded and decoded, or as they are."""

    def __init__(self, unit: Unit, meter: Meter, write: Callable[[bytes], object] | None) -> None:
        self.unit, self._meter, self._write = unit, meter, write
        self._encoder: Encoder | None = None
        self._decoder = None if unit.condition.codec is None else Decoder(unit.condition.codec)

    def through(self, scaled: _Scaled, number: int, index: int) -> VideoFrame | None:
        """The frame to look at, None if nobody looks at this one."""
        if self._decoder is None:
            return scaled.as_it_is() if index in self.unit.looked else None
        data = self._encoded(scaled.to_encode(), number)
        self._meter.count(data)
        if self._write is not None:
            with self._meter.spending("write"):
                self._write(data)
        with self._meter.spending("decode"):
            frame = self._decoder.decode_frame(data)
        return frame if index in self.unit.looked else None

    def _encoded(self, frame: VideoFrame, number: int) -> bytes:
        if self._encoder is None:
            unit, condition = self.unit, self.unit.condition
            assert condition.codec is not None
            assert condition.bitrate_bps is not None
            self._encoder = Encoder(
                condition.codec,
                frame.width,
                frame.height,
                unit.frame_rate_hz,
                condition.bitrate_bps,
                unit.keyframe_interval,
            )
        with self._meter.spending("encode"):
            return self._encoder.encode_frame(frame, number).data


def _source(unit: Unit, meter: Meter) -> Iterator[tuple[int, VideoFrame]]:
    """The kept frames of the sequence, with their numbers."""
    kept = frozenset(unit.kept)
    frames = decoded_frames(unit.files[0]) if unit.is_video else map(_image, unit.files)
    for index in range(unit.kept[-1] + 1):
        with meter.spending("source"):
            frame = next(frames)
        if index in kept:
            yield index, frame


def _image(file: object) -> VideoFrame:
    try:
        with av.open(str(file)) as container:
            return next(container.decode(video=0))
    except (av.FFmpegError, OSError, StopIteration, IndexError):
        raise InputError(file, "a file that is not an image", "a JPEG, PNG or BMP image") from None
