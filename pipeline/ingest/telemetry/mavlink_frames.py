"""Frames of MAVLink 1 and 2 in a telemetry log (``.tlog``): 8 bytes of time, then a frame, again and again.

Only the wanted messages are unpacked (by pymavlink, which checks the checksum); the others are stepped over.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator
from dataclasses import dataclass
from typing import Any

from pipeline.ingest.samples import LeftOut

#: first byte of a frame -> bytes of header, and of header with checksum
_MAGIC = {0xFE: (6, 8), 0xFD: (10, 12)}
_FIRST_BYTE = re.compile(rb"[\xfd\xfe]")
_SIGNED, _SIGNATURE_BYTES, _STAMP_BYTES = 0x01, 13, 8


@dataclass(frozen=True, slots=True)
class LoggedMessage:
    """received_us: when the ground station got it, since 1970 by its clock. system, component: who sent it."""

    received_us: int
    system: int
    component: int
    id: int
    fields: Any


def is_frame_after_stamp(data: bytes, position: int) -> bool:
    """Whether a time and the first byte of a frame stand at a position."""
    return position + _STAMP_BYTES < len(data) and data[position + _STAMP_BYTES] in _MAGIC


def frames_in(data: bytes) -> Iterator[bytes]:
    """The whole frames of bytes without times, such as a datagram; what is between them is stepped over."""
    position = 0
    while position < len(data):
        length = _frame_length(data, position)
        if length is None or position + length > len(data):
            position += 1
            continue
        yield data[position : position + length]
        position += length


def messages_of(
    data: bytes, wanted: Container[int], where: object, left_out: LeftOut
) -> Iterator[LoggedMessage]:
    """The wanted messages in the order of the file. Damaged ones are counted; the next whole frame goes on."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    decoder = dialect.MAVLink(None)
    position = 0
    while position + _STAMP_BYTES < len(data):
        length = _frame_length(data, position + _STAMP_BYTES)
        if length is None:
            left_out.add("damaged", f"{where} byte {position}")
            position = _next_frame(data, position + 1)
            continue
        start, end = position + _STAMP_BYTES, position + _STAMP_BYTES + length
        if end > len(data):
            left_out.add("cut_off", f"{where} byte {position}")
            return
        two = data[start] == 0xFD
        number = int.from_bytes(data[start + 7 : start + 10], "little") if two else data[start + 5]
        if number in wanted:
            try:
                fields = decoder.decode(bytearray(data[start:end]))
            except Exception:  # pymavlink raises MAVError, struct.error, TypeError .. for a damaged frame
                left_out.add("checksum", f"{where} byte {position}")
                position = _next_frame(data, position + 1)
                continue
            system, component = (
                (data[start + 5], data[start + 6]) if two else (data[start + 3], data[start + 4])
            )
            stamp_us = int.from_bytes(data[position:start], "big")
            yield LoggedMessage(stamp_us, system, component, number, fields)
        position = end


def _frame_length(data: bytes, start: int) -> int | None:
    if start >= len(data) or data[start] not in _MAGIC:
        return None
    header, overhead = _MAGIC[data[start]]
    if start + header > len(data):
        return overhead + 255  # beyond the end: cut off
    signed = data[start] == 0xFD and data[start + 2] & _SIGNED
    return overhead + data[start + 1] + (_SIGNATURE_BYTES if signed else 0)


def _next_frame(data: bytes, position: int) -> int:
    """The next position of a time and a frame that is followed by another one, or the end of the file."""
    for found in _FIRST_BYTE.finditer(data, position + _STAMP_BYTES):
        length = _frame_length(data, found.start())
        following = found.start() + (length or 0)
        if following == len(data) or is_frame_after_stamp(data, following):
            return found.start() - _STAMP_BYTES
    return len(data)
