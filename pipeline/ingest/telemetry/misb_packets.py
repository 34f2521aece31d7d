"""Packets of MISB ST 0601 (UAS Datalink Local Set) in a run of bytes; damage costs the packet that it hits."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

from pipeline.ingest.samples import LeftOut

#: the 16-byte key of the UAS Datalink Local Set
KEY = bytes.fromhex("060e2b34020b01010e01030101000000")
#: that of the older universal set (EG 0104), which is another format
OLD_KEY = bytes.fromhex("060e2b34020101010e0101020101")
#: packets are a few hundred bytes; with lists of targets a few tens of thousands
_LONGEST = 262_144
#: bytes that are tried in vain, over those of the file, before it is given up: every key could claim the rest
_MOST_TRIED = 20


@dataclass(frozen=True, slots=True)
class MisbPacket:
    """number: from 1, of whole packets. piece: in which of the file's pieces it begins. fields: see tstrans."""

    number: int
    piece: int
    fields: Any


def packets_of(pieces: Sequence[bytes], where: object, left_out: LeftOut) -> Iterator[MisbPacket]:
    """The packets whose checksum holds, in order; the others are counted. A packet may go on in the next piece."""
    from tstrans.exceptions import KlvError
    from tstrans.klv import decode_uas_datalink

    data = b"".join(pieces)
    starts = list(accumulate((len(piece) for piece in pieces), initial=0))[:-1]
    position, number, tried = data.find(KEY), 0, 0
    while position >= 0:
        end = _end(data, position)
        number += 1
        place = f"{where} packet {number}"
        if end is None:
            left_out.add("cut_off", place)
            position = data.find(KEY, position + len(KEY))
            continue
        try:
            fields = decode_uas_datalink(data[position:end])
        except KlvError as error:
            left_out.add("checksum" if "checksum" in str(error) else "unreadable", place)
            # the length may be what is damaged: the next key is looked for inside
            tried += end - position
            if tried > _MOST_TRIED * len(data):
                return
            position = data.find(KEY, position + len(KEY))
            continue
        yield MisbPacket(number, bisect_right(starts, position) - 1, fields)
        position = data.find(KEY, end)


def _end(data: bytes, position: int) -> int | None:
    """Where a packet ends by its length (BER, short or long); None if that is beyond the file or no length."""
    cursor = position + len(KEY)
    if cursor >= len(data):
        return None
    length = data[cursor]
    cursor += 1
    if length > 0x80:
        size = length & 0x7F
        if size > 4 or cursor + size > len(data):
            return None
        length = int.from_bytes(data[cursor : cursor + size], "big")
        cursor += size
    elif length == 0x80:
        return None
    return cursor + length if length <= _LONGEST and cursor + length <= len(data) else None
