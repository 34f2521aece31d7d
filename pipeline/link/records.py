"""Sealed messages on a byte stream: the length, 4 bytes big-endian, then a Noise transport message of that length.

A record is a message encrypted and authenticated (AES-256-GCM, 16 bytes of tag) under the key of its direction; its
number is not sent, but counted at both ends. So a record that was changed, left out, sent twice or put elsewhere cannot
be read, and neither can any after it. One record holds one message of at most MAX_MESSAGE_BYTES, more than the 65,535
bytes that Noise foresees: a message is taken whole or not at all. An empty one is a heartbeat. The key is changed
(Noise's REKEY) after every REKEY_BYTES of messages, far below what one key of AES-GCM may protect.
"""

from __future__ import annotations

import struct

from pipeline.errors import ProtocolError
from pipeline.link.noise import TAG_BYTES, CipherState
from pipeline.messages import MAX_MESSAGE_BYTES

_LENGTH = struct.Struct(">I")
#: what a record is longer than its message
OVERHEAD_BYTES = _LENGTH.size + TAG_BYTES
#: one key protects at most so much: 2**30 blocks, of the 2**34.5 of RFC 8446, section 5.5
REKEY_BYTES = 2**34
#: a sign of life of a sender that has nothing to say
HEARTBEAT = b""


def record_bytes(message: bytes) -> int:
    """How long the message's record is. Raises ProtocolError if it is larger than a receiver takes."""
    if len(message) > MAX_MESSAGE_BYTES:
        raise ProtocolError(f"a message of {len(message)} bytes; at most {MAX_MESSAGE_BYTES} are taken")
    return len(message) + OVERHEAD_BYTES


class RecordWriter:
    """Seals messages in the order in which they are to be sent. Not locked."""

    def __init__(self, cipher: CipherState, rekey_bytes: int = REKEY_BYTES) -> None:
        self._cipher, self._keys = cipher, _Keys(cipher, rekey_bytes)

    def seal(self, message: bytes) -> bytearray:
        """The record of a message that ``record_bytes`` has let pass."""
        record = bytearray(len(message) + OVERHEAD_BYTES)
        _LENGTH.pack_into(record, 0, len(message) + TAG_BYTES)
        self._cipher.encrypt_into(message, memoryview(record)[_LENGTH.size :])
        self._keys.count(len(message))
        return record


class RecordReader:
    """Takes the stream in pieces of any size; holds at most one record and one piece. heard: how many records came."""

    def __init__(self, cipher: CipherState, rekey_bytes: int = REKEY_BYTES) -> None:
        self._cipher, self._keys = cipher, _Keys(cipher, rekey_bytes)
        self._buffer = bytearray()
        self.heard = 0

    @property
    def is_cut(self) -> bool:
        """Whether a record has begun and not ended: the stream must not end now."""
        return bool(self._buffer)

    def feed(self, data: bytes) -> list[bytes]:
        """The messages completed by these bytes, no heartbeats. Raises ProtocolError at the first record that is not
        the next one of the other end, or whose length is over the limit.
        """
        self._buffer += data
        messages, position = [], 0
        with memoryview(self._buffer) as view:
            while (end := self._end(position)) is not None:
                message = self._cipher.decrypt(view[position + _LENGTH.size : end])
                self._keys.count(len(message))
                self.heard += 1
                position = end
                if message:
                    messages.append(message)
        del self._buffer[:position]
        return messages

    def _end(self, position: int) -> int | None:
        """Where the record at a position ends, if it is all there."""
        if len(self._buffer) < position + _LENGTH.size:
            return None
        length: int = _LENGTH.unpack_from(self._buffer, position)[0]
        if not TAG_BYTES <= length <= MAX_MESSAGE_BYTES + TAG_BYTES:
            raise ProtocolError(
                f"a record of {length} bytes; at most {MAX_MESSAGE_BYTES} of message are taken", "bad_length"
            )
        end = position + _LENGTH.size + length
        return end if end <= len(self._buffer) else None


class _Keys:
    """When the key of a direction is to be changed: at the same message at both ends."""

    __slots__ = ("_cipher", "_left", "_of_each")

    def __init__(self, cipher: CipherState, of_each: int) -> None:
        self._cipher, self._of_each, self._left = cipher, of_each, of_each

    def count(self, nbytes: int) -> None:
        self._left -= nbytes
        if self._left <= 0:
            self._cipher.rekey()
            self._left = self._of_each
