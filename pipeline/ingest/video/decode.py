"""The pictures of one file in the order in which they are shown, the lost ones in their place."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from typing import Literal

import av
from av.container import InputContainer
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from pipeline.ingest.video.container import is_counted, timed_packets

#: before ``from_ticks``, and not decoded; or not to be had
NotShown = Literal["skipped", "damaged"]


def shown_frames(
    container: InputContainer, stream: VideoStream, from_ticks: int | None = None
) -> Iterator[tuple[int, VideoFrame | NotShown]]:
    """Time (units of stream.time_base) and FFmpeg's frame, of every picture that the file holds.

    A packet announces its picture: one that the decoder does not give, or calls corrupt, is ``damaged``. From the
    last one that stands alone before from_ticks the pictures are decoded, those before it are ``skipped``.
    """
    announced: list[int] = []
    counted = is_counted(container)
    for packet, ticks, skipped in _from(timed_packets(container, stream), from_ticks):
        if skipped:
            yield ticks, "skipped"
            continue
        if not packet.is_discard:
            heapq.heappush(announced, ticks)
        packet.pts = ticks
        for frame in _decoded(stream, packet):
            yield from _in_place(announced, frame, None if counted else frame.pts)
    for frame in _decoded(stream, None):
        yield from _in_place(announced, frame, None if counted else frame.pts)
    while announced:
        yield heapq.heappop(announced), "damaged"


def _from(
    packets: Iterator[tuple[Packet[VideoStream], int]], from_ticks: int | None
) -> Iterator[tuple[Packet[VideoStream], int, bool]]:
    """Packets, and whether they are not needed for a picture from from_ticks on."""
    held: list[tuple[Packet[VideoStream], int]] = []
    for packet, ticks in packets:
        if from_ticks is not None and ticks < from_ticks:
            if packet.is_keyframe:
                yield from ((p, t, True) for p, t in held if not p.is_discard)
                held = []
            held.append((packet, ticks))
            continue
        yield from ((p, t, False) for p, t in held)
        held, from_ticks = [], None
        yield packet, ticks, False
    yield from ((p, t, True) for p, t in held if not p.is_discard)


def _decoded(stream: VideoStream, packet: Packet[VideoStream] | None) -> list[VideoFrame]:
    try:
        return list(stream.codec_context.decode(packet))
    except (av.FFmpegError, ValueError):
        return []


def _in_place(
    announced: list[int], frame: VideoFrame, ticks: int | None
) -> Iterator[tuple[int, VideoFrame | NotShown]]:
    """The frame, and before it those that were announced for earlier and will not come."""
    if ticks is None:
        ticks = announced[0] if announced else 0
    while announced and announced[0] < ticks:
        yield heapq.heappop(announced), "damaged"
    if announced and announced[0] == ticks:
        heapq.heappop(announced)
    yield ticks, "damaged" if frame.is_corrupt else frame
