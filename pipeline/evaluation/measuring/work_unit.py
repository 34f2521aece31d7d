"""The unit of work: one sequence under one codec and bitrate, looked at by every detector."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import cast

import av
import numpy as np
from av.video.frame import VideoFrame
from numpy.typing import NDArray

from pipeline.detection import Detector, load_detector
from pipeline.errors import InputError
from pipeline.evaluation.measuring.packet_file import read_packets, writing_packets
from pipeline.evaluation.metrics.boxes import IntArray
from pipeline.evaluation.metrics.matching import MOST_FOUND
from pipeline.ingest.video.file import decoded_frames
from pipeline.link.codec import Codec, Decoder, Encoder
from pipeline.messages import FloatArray


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


@dataclass(frozen=True, eq=False)
class Found:
    """What one detector found: image int64 (N,), boxes_px float64 (N, 4) xyxy, score float64 (N,).

    not_finite: detections that were NaN or infinite, and are left out.
    """

    image: IntArray
    boxes_px: FloatArray
    score: FloatArray
    not_finite: int
    detect_s: float


@dataclass(frozen=True, eq=False)
class UnitResult:
    """total_bytes: of all packets. frames: encoded. seconds: spent on each part of the work."""

    total_bytes: int
    largest_packet_bytes: int
    frames: int
    seconds: dict[str, float]
    found: dict[str, Found]


@dataclass
class _Meter:
    """Bytes, and seconds by what they were spent on."""

    total_bytes: int = 0
    largest: int = 0
    seconds: dict[str, float] = field(default_factory=dict)

    def count(self, data: bytes) -> None:
        self.total_bytes += len(data)
        self.largest = max(self.largest, len(data))

    @contextmanager
    def spending(self, part: str) -> Iterator[None]:
        started = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[part] = self.seconds.get(part, 0.0) + time.perf_counter() - started

    def timed(self, part: str, data: Iterator[bytes]) -> Iterator[bytes]:
        """The same, and how long each takes to come counts as spent on the part."""
        while True:
            with self.spending(part):
                item = next(data, None)
            if item is None:
                return
            yield item


def work(unit: Unit) -> UnitResult:
    """Encode, decode and detect. Raises InputError for files that cannot be read or encoded."""
    started, meter = time.perf_counter(), _Meter()
    with meter.spending("load"):
        scanners = {m.id: _Scanner(_opened(m.path, m.provider, unit.score_cutoff)) for m in unit.models}
    for frame, picture in _looked_at(unit, meter):
        image = cast("NDArray[np.uint8]", frame.to_ndarray(format="rgb24"))
        for scanner in scanners.values():
            with meter.spending("detect"):
                scanner.look(image, picture)
    meter.seconds["other"] = time.perf_counter() - started - sum(meter.seconds.values())
    found = {name: scanner.found() for name, scanner in scanners.items()}
    return UnitResult(meter.total_bytes, meter.largest, len(unit.kept), meter.seconds, found)


def first_pictures(unit: Unit, count: int) -> list[NDArray[np.uint8]]:
    """The first pictures that are looked at, uint8 (H, W, 3) RGB, as a detector gets them."""
    frames = islice(_looked_at(unit, _Meter()), count)
    return [cast("NDArray[np.uint8]", frame.to_ndarray(format="rgb24")) for frame, _ in frames]


@lru_cache(maxsize=32)
def _opened(path: Path, provider: str, score_cutoff: float) -> Detector:
    return load_detector(path, score_threshold=score_cutoff, provider=provider)


def _looked_at(unit: Unit, meter: _Meter) -> Iterator[tuple[VideoFrame, int]]:
    """The frames to look at, as they come out of the decoder, with their pictures' numbers."""
    if unit.condition.codec is None:
        for index, frame in _source(unit, meter):
            if index in unit.looked:
                yield frame, unit.looked[index]
        return
    decoder = Decoder(unit.condition.codec)
    for index, data in zip(unit.kept, _packets(unit, meter), strict=True):
        meter.count(data)
        with meter.spending("decode"):
            frame = decoder.decode_frame(data)
        if index in unit.looked:
            yield frame, unit.looked[index]


def _packets(unit: Unit, meter: _Meter) -> Iterator[bytes]:
    if unit.packets is not None and unit.packets.is_file():
        yield from meter.timed("read", read_packets(unit.packets))
    elif unit.packets is None:
        yield from _encoded(unit, meter)
    else:
        with writing_packets(unit.packets) as write:
            for data in _encoded(unit, meter):
                with meter.spending("write"):
                    write(data)
                yield data


def _encoded(unit: Unit, meter: _Meter) -> Iterator[bytes]:
    encoder: Encoder | None = None
    codec, bitrate_bps = unit.condition.codec, unit.condition.bitrate_bps
    assert codec is not None
    assert bitrate_bps is not None
    for number, (_, frame) in enumerate(_source(unit, meter)):
        if encoder is None:
            encoder = Encoder(
                codec, frame.width, frame.height, unit.frame_rate_hz, bitrate_bps, unit.keyframe_interval
            )
        with meter.spending("encode"):
            encoded = encoder.encode_frame(frame, number)
        yield encoded.data


def _source(unit: Unit, meter: _Meter) -> Iterator[tuple[int, VideoFrame]]:
    """The kept frames of the sequence, yuv420p in the wanted size, with their numbers."""
    kept = frozenset(unit.kept)
    frames = decoded_frames(unit.files[0]) if unit.is_video else map(_image, unit.files)
    last, index = unit.kept[-1], 0
    while index <= last:
        with meter.spending("source"):
            frame = next(frames)
            if index in kept:
                width, height = unit.size or (frame.width, frame.height)
                wanted = "yuv420p" if unit.condition.codec else frame.format.name
                frame = frame.reformat(width, height, wanted, interpolation="AREA")
        if index in kept:
            yield index, frame
        index += 1


def _image(file: Path) -> VideoFrame:
    try:
        with av.open(str(file)) as container:
            return next(container.decode(video=0))
    except (av.FFmpegError, OSError, StopIteration, IndexError):
        raise InputError(file, "a file that is not an image", "a JPEG, PNG or BMP image") from None


class _Scanner:
    """One detector, and what it has found so far."""

    def __init__(self, detector: Detector) -> None:
        self._detector = detector
        self._rows: list[tuple[int, FloatArray, FloatArray]] = []
        self._not_finite = 0
        self._seconds = 0.0

    def look(self, image: NDArray[np.uint8], picture: int) -> None:
        started = time.perf_counter()
        boxes, scores, classes = self._detector.candidates(image)
        finite = self._detector.finite(boxes, scores)
        self._not_finite += int((~finite).sum())
        boxes, scores, _ = self._detector.chosen(image, boxes[finite], scores[finite], classes[finite])
        # they come by falling score, and no metric takes more
        self._rows.append((picture, boxes[:MOST_FOUND], scores[:MOST_FOUND]))
        self._seconds += time.perf_counter() - started

    def found(self) -> Found:
        pictures = [np.full(len(scores), picture, np.int64) for picture, _, scores in self._rows]
        return Found(
            np.concatenate([np.zeros(0, np.int64), *pictures]),
            np.concatenate([np.zeros((0, 4)), *(boxes for _, boxes, _ in self._rows)]),
            np.concatenate([np.zeros(0), *(scores for _, _, scores in self._rows)]),
            self._not_finite,
            self._seconds,
        )
