"""Packets that nobody needs: after the last picture that is sampled, until the next one that stands alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal, TypeAlias

from av.packet import Packet
from av.video.stream import VideoStream

#: what becomes of a packet: before the part that is used; decoded; not decoded, since no picture refers to it
Fate = Literal["skipped", "decoded", "unneeded"]
#: (time of a picture, time of the next one, units of the track's time_base) -> whether it is sampled
Needed = Callable[[int, int], bool]
Fated: TypeAlias = "tuple[Packet[VideoStream], int, Fate]"


def without_unneeded(packets: Iterator[Fated], needed: Needed) -> Iterator[Fated]:
    """The packets, each with its time and fate; those that are left out are called unneeded.

    Only where pictures are shown in the order in which they are decoded: else those behind the next one that stands
    alone may refer to those before it. From the first that is out of order on, all are decoded.
    """
    held: list[tuple[Packet[VideoStream], int]] = []
    in_order = True

    def all_held(fate: Fate) -> Iterator[Fated]:
        yield from ((packet, ticks, fate) for packet, ticks in held)
        held.clear()

    for packet, ticks, fate in packets:
        if held:
            in_order = in_order and ticks > held[-1][1]
            if not in_order or needed(held[-1][1], ticks):
                yield from all_held("decoded")
            elif packet.is_keyframe:
                yield from all_held("unneeded")
        if in_order and fate == "decoded" and not packet.is_discard and not packet.is_corrupt:
            held.append((packet, ticks))
        else:
            yield from all_held("decoded")
            yield packet, ticks, fate
    yield from all_held("decoded")
