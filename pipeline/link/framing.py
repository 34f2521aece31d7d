"""Messages on a byte stream: the length, 4 bytes big-endian, then the message. A length of 0 is a heartbeat."""

from __future__ import annotations

import struct

from pipeline.errors import ProtocolError
from pipeline.messages import MAX_MESSAGE_BYTES

_LENGTH = struct.Struct(">I")
#: a sign of life of a sender that has nothing to say
HEARTBEAT = _LENGTH.pack(0)


def frame(message: bytes) -> bytes:
    """The bytes on the wire. Raises ProtocolError if the message is larger than a receiver takes."""
    _require_bounded(len(message))
    return _LENGTH.pack(len(message)) + message


class FrameReader:
    """Takes the stream in pieces of any size; holds at most one message and one piece."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """The messages completed by these bytes, no heartbeats. Raises ProtocolError for a length over the limit."""
        self._buffer += data
        messages, position = [], 0
        while (end := self._end(position)) is not None:
            if end > position + _LENGTH.size:
                messages.append(bytes(self._buffer[position + _LENGTH.size : end]))
            position = end
        del self._buffer[:position]
        return messages

    def _end(self, position: int) -> int | None:
        """Where the message at a position ends, if it is all there."""
        if len(self._buffer) < position + _LENGTH.size:
            return None
        (length,) = _LENGTH.unpack_from(self._buffer, position)
        _require_bounded(length)
        end = position + _LENGTH.size + int(length)
        return end if end <= len(self._buffer) else None


def _require_bounded(length: int) -> None:
    if length > MAX_MESSAGE_BYTES:
        raise ProtocolError(f"a message of {length} bytes; at most {MAX_MESSAGE_BYTES} are taken")
