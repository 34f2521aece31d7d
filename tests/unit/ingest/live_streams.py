"""For tests of live streams: a source without a mission, and what comes of it."""

from __future__ import annotations

import io
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np

from pipeline.config.live import Live
from pipeline.config.stream_url import StreamUrl
from pipeline.config.telemetry import Telemetry
from pipeline.ingest.live.source import LiveSource
from pipeline.ingest.source import LostPicture, PassedPicture, Picture, SourceInfo
from pipeline.ingest.track import Track

Item = Picture | LostPicture | PassedPicture


class Way:
    """Stands in for a camera's way: every picture has its telemetry at once."""

    fault = ""

    def __init__(self) -> None:
        self.tracks: list[Track] = []

    def extend(self, track: Track) -> None:
        self.tracks.append(track)

    def wait_until_known(self, time_s: float, most_s: float) -> bool:
        return True


def free_port() -> int:
    """Of UDP and TCP."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def live_source(
    url: str, way: Any = None, *, size: tuple[int, int] = (160, 120), **live: float | str
) -> LiveSource:
    """As a mission would have it, of pictures of a size."""
    given = {k: {"seconds": v} if isinstance(v, float) else v for k, v in live.items()}
    info = SourceInfo(*size, 10.0, None, None, constant=False)
    seen = StreamUrl(url)
    return LiveSource(
        "one", seen, Live.model_validate(given), Telemetry(file=Path("-"), heard=seen), info, size,
        time.time_ns(), way or Way(),
    )  # fmt: skip


@contextmanager
def read(source: LiveSource, rate_hz: float = 10.0) -> Iterator[Callable[..., list[Item]]]:
    """A function that reads on until a condition on all that came holds; it fails after 15 s."""
    pictures = source.pictures(rate_hz)
    came: list[Item] = []

    def until(condition: Callable[[list[Item]], bool], most_s: float = 15.0) -> list[Item]:
        end_s = time.monotonic() + most_s
        while not condition(came):
            assert time.monotonic() < end_s, (source.health, [type(c).__name__ for c in came][-5:])
            item = next(pictures, None)
            if item is None:
                break
            if isinstance(item, Picture | LostPicture | PassedPicture):
                came.append(item)
        return came

    try:
        yield until
    finally:
        pictures.close()  # type: ignore[attr-defined]


def taken(came: list[Item]) -> list[Picture]:
    """The pictures that are to be looked at."""
    return [item for item in came if isinstance(item, Picture)]


def encoded(count: int, size: tuple[int, int] = (160, 120), rate_hz: int = 10) -> list[bytes]:
    """Pictures of one slice each, Annex B, the first one stands alone."""
    codec = av.CodecContext.create("libx264", "w")
    codec.width, codec.height, codec.pix_fmt = *size, "yuv420p"
    codec.framerate, codec.time_base = Fraction(rate_hz), Fraction(1, rate_hz)
    codec.options = {"preset": "ultrafast", "tune": "zerolatency", "g": str(count), "bf": "0", "slices": "1"}
    codec.options |= {"x264-params": f"sliced-threads=0:slices=1:keyint={count}"}
    result = []
    for i in range(count):
        frame = av.VideoFrame.from_ndarray(
            np.full((size[1], size[0], 3), 9 * i % 256, np.uint8), format="rgb24"
        )
        frame.pts, frame.time_base = i, Fraction(1, rate_hz)
        result += [bytes(packet) for packet in codec.encode(frame)]
    return result + [bytes(packet) for packet in codec.encode(None)]


def transport_stream(seconds: float, size: tuple[int, int] = (160, 120)) -> bytes:
    """A made-up video, ten pictures a second, a group each second."""
    out = io.BytesIO()
    with av.open(out, "w", format="mpegts") as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        stream.options = {"preset": "ultrafast", "g": "10", "bf": "0"}
        for i in range(round(10 * seconds)):
            image = np.random.default_rng(i).integers(0, 255, (size[1], size[0], 3), np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))
    return out.getvalue()
