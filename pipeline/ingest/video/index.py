"""When the pictures of a file are shown, from its index; no picture is decoded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from av.container import InputContainer
from av.video.stream import VideoStream
from numpy.typing import NDArray

from pipeline.ingest.video.container import LONGEST_GAP_S, is_counted, opened, timed_packets
from pipeline.messages import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class PictureIndex:
    """times_s: float64 (N,), increasing, since the first picture. first_ticks: its time, units of the track's
    time_base. tick_s: that unit. whole: how many of them the file holds; the others are ``missing``, promised only,
    or ``damaged``.

    Of an MP4 the times are those of decoding, in order and moved to the first picture: the same at a constant
    rate, and else as near as pictures change their order.
    """

    times_s: FloatArray
    first_ticks: int
    tick_s: float
    whole: int
    others: Literal["missing", "damaged"]


def read_index(path: Path, container: InputContainer, stream: VideoStream) -> PictureIndex:
    """From the container's own index if it is complete (MP4, MOV, AVI), else from the heads of the packets."""
    entries = stream.index_entries
    if not has_own_index(container, stream):
        return _from_packets(container, stream)
    size = path.stat().st_size
    shown = [(e.timestamp, e.pos + e.size <= size) for e in entries if not e.is_discard]
    ticks = np.sort(np.array([t for t, _ in shown], np.int64))
    first = stream.start_time if stream.start_time is not None and not is_counted(container) else None
    whole = sum(1 for _, is_whole in shown if is_whole)
    return _index(ticks, int(first) if first is not None else None, stream, whole, "missing")


def has_own_index(container: InputContainer, stream: VideoStream) -> bool:
    """Whether the container says itself where its pictures are, so that reading them leaves it at its beginning."""
    return container.format.name.startswith(("mov", "avi")) and len(stream.index_entries) >= stream.frames > 0


def exact_times_s(path: Path) -> FloatArray:
    """Presentation time of every picture since the first one, seconds, increasing; reads the whole file."""
    with opened(path) as (container, stream):
        return _from_packets(container, stream).times_s


def _from_packets(container: InputContainer, stream: VideoStream) -> PictureIndex:
    ticks, whole = [], 0
    for packet, at in timed_packets(container, stream):
        if not packet.is_discard:
            ticks.append(at)
            whole += not packet.is_corrupt
    return _index(np.sort(np.array(ticks, np.int64)), None, stream, whole, "damaged")


def _index(
    ticks: NDArray[np.int64],
    first: int | None,
    stream: VideoStream,
    whole: int,
    others: Literal["missing", "damaged"],
) -> PictureIndex:
    tick_s = float(stream.time_base or 1)
    steps_s = np.diff(ticks).astype(np.float64) * tick_s
    # as timed_packets: no gap, but a clock that begins anew, or damage
    if (steps_s > LONGEST_GAP_S).any():
        steps_s[steps_s > LONGEST_GAP_S] = tick_s
        ticks = ticks[0] + np.concatenate([[0], np.round(np.cumsum(steps_s) / tick_s).astype(np.int64)])
    times_s = (ticks - ticks[0]).astype(np.float64) * tick_s if len(ticks) else np.zeros(0)
    start = first if first is not None else int(ticks[0]) if len(ticks) else 0
    return PictureIndex(times_s, start, tick_s, whole, others)
