"""Small videos for tests, written with PyAV: each picture has one gray, so that it tells its number."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

#: width, height
SIZE = (96, 64)


def gray(index: int) -> int:
    return 20 + 6 * (index % 35)


def plain(index: int, size: tuple[int, int] = SIZE) -> NDArray[np.uint8]:
    """One gray, with a noise that every picture shares."""
    noise = np.random.default_rng(0).integers(-8, 9, (size[1], size[0], 1))
    return np.repeat(np.clip(gray(index) + noise, 0, 255), 3, axis=2).astype(np.uint8)


def busy(index: int, size: tuple[int, int] = SIZE) -> NDArray[np.uint8]:
    """Noise of its own: large packets, in which damage hits something."""
    return np.random.default_rng(index).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)


def write_video(
    path: Path,
    count: int = 30,
    rate: int = 10,
    *,
    times: Sequence[Fraction | float] | None = None,
    size: tuple[int, int] = SIZE,
    codec: str = "libx264",
    pix_fmt: str = "yuv420p",
    options: dict[str, str] | None = None,
    container_options: dict[str, str] | None = None,
    metadata: dict[str, str] | None = None,
    aspect: Fraction | None = None,
    rotation: int | None = None,
    picture: Callable[[int, tuple[int, int]], NDArray[np.uint8]] = plain,
) -> Path:
    """times: of the pictures, seconds; absent: at the rate. With B-frames, so that order matters."""
    shown = times if times is not None else [Fraction(i, rate) for i in range(count)]
    with av.open(str(path), "w", options=container_options or {}) as container:
        container.metadata.update(metadata or {})
        stream = container.add_stream(codec, rate=rate, options=options or {"bf": "2", "g": "10"})
        stream.width, stream.height, stream.pix_fmt = *size, pix_fmt
        stream.codec_context.time_base = Fraction(1, 30_000)
        if aspect is not None:
            stream.codec_context.sample_aspect_ratio = aspect
        if pix_fmt == "gray":
            stream.codec_context.color_range = 2
        if rotation is not None:
            stream.set_display_rotation(rotation)
        if not shown:
            container.start_encoding()
        for index, time_s in enumerate(shown):
            frame = av.VideoFrame.from_ndarray(picture(index, size), format="rgb24").reformat(format=pix_fmt)
            frame.pts, frame.time_base = round(time_s * 30_000), Fraction(1, 30_000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def packet_places(path: Path) -> list[tuple[int, int, bool]]:
    """Position in the file, bytes, and whether it stands alone, of every packet in decoding order."""
    with av.open(str(path)) as container:
        return [(p.pos, p.size, p.is_keyframe) for p in container.demux(video=0) if p.size]
