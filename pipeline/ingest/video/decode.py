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
from pipeline.ingest.video.needed import Fated, Needed, without_unneeded

#: before ``from_ticks``, or not needed, and not decoded; or not to be had
NotShown = Literal["skipped", "unneeded", "damaged"]


def shown_frames(
    container: InputContainer,
    stream: VideoStream,
    from_ticks: int | None = None,
    needed: Needed | None = None,
) -> Iterator[tuple[int, VideoFrame | NotShown]]:
    """Time (units of stream.time_base) and FFmpeg's frame, of every picture that the file holds.

    A packet announces its picture: one that the decoder does not give, or calls corrupt, is ``damaged``. From the
    last one that stands alone before from_ticks the pictures are decoded, those before it are ``skipped``. needed:
    which pictures are; those that are not, and that no needed one refers to, are ``unneeded``.
    """
    announced, unneeded = list[int](), set[int]()
    counted = is_counted(container)
    packets = _from(timed_packets(container, stream), from_ticks)
    if needed is not None and not counted and not stream.codec_context.has_b_frames:
        packets = without_unneeded(packets, needed)
    left_out = False
    for packet, ticks, fate in packets:
        if fate == "skipped":
            yield ticks, "skipped"
            continue
        if fate == "decoded" and left_out:
            # a new beginning, as after a jump: the decoder must not miss what was left out
            for frame in _decoded(stream, None):
                yield from _in_place(announced, frame, frame.pts, unneeded)
            stream.codec_context.flush_buffers()
        left_out = fate == "unneeded"
        if not packet.is_discard:
            heapq.heappush(announced, ticks)
        if left_out:
            unneeded.add(ticks)
            continue
        packet.pts = ticks
        for frame in _decoded(stream, packet):
            yield from _in_place(announced, frame, None if counted else frame.pts, unneeded)
    for frame in _decoded(stream, None):
        yield from _in_place(announced, frame, None if counted else frame.pts, unneeded)
    while announced:
        yield _not_given(heapq.heappop(announced), unneeded)


def _from(packets: Iterator[tuple[Packet[VideoStream], int]], from_ticks: int | None) -> Iterator[Fated]:
    """Packets; those that no picture from from_ticks on refers to are skipped."""
    held: list[tuple[Packet[VideoStream], int]] = []
    for packet, ticks in packets:
        if from_ticks is not None and ticks < from_ticks:
            if packet.is_keyframe:
                yield from ((p, t, "skipped") for p, t in held if not p.is_discard)
                held = []
            held.append((packet, ticks))
            continue
        yield from ((p, t, "decoded") for p, t in held)
        held, from_ticks = [], None
        yield packet, ticks, "decoded"
    yield from ((p, t, "skipped") for p, t in held if not p.is_discard)


def _decoded(stream: VideoStream, packet: Packet[VideoStream] | None) -> list[VideoFrame]:
    try:
        return list(stream.codec_context.decode(packet))
    except (av.FFmpegError, ValueError):
        return []


def _in_place(
    announced: list[int], frame: VideoFrame, ticks: int | None, unneeded: set[int]
) -> Iterator[tuple[int, VideoFrame | NotShown]]:
    """The frame, and before it those that were announced for earlier and will not come."""
    if ticks is None:
        ticks = announced[0] if announced else 0
    while announced and announced[0] < ticks:
        yield _not_given(heapq.heappop(announced), unneeded)
    if announced and announced[0] == ticks:
        heapq.heappop(announced)
    yield ticks, "damaged" if frame.is_corrupt else frame


def _not_given(ticks: int, unneeded: set[int]) -> tuple[int, NotShown]:
    """What was announced, and the decoder did not give."""
    if ticks in unneeded:
        unneeded.discard(ticks)
        return ticks, "unneeded"
    return ticks, "damaged"
