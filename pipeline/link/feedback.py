"""What the far end of a connection says back, on the same connection and sealed as well: small binary records.

Read: kind 1, how many bytes it has read (8 bytes) and when (8 bytes, ns of its own monotonic clock). It comes at least
at every heartbeat, so it is the sign of life too.
Restart: kind 2, the lengths of two names (2 bytes each), stream and detector in UTF-8: a packet of this substream was
not taken, so the next one that is must stand alone.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from pipeline.errors import ProtocolError

_READ = struct.Struct(">BQQ")
_RESTART = struct.Struct(">BHH")


@dataclass(frozen=True, slots=True)
class Read:
    """total_bytes since the handshake; at_s: of the far end's clock, which tells differences only."""

    total_bytes: int
    at_s: float


@dataclass(frozen=True, slots=True)
class Restart:
    """The encoder of a substream has to begin anew."""

    stream: str
    detector: str


Feedback = Read | Restart


def pack_feedback(feedback: Feedback) -> bytes:
    """The record's bytes."""
    if isinstance(feedback, Read):
        return _READ.pack(1, feedback.total_bytes, round(feedback.at_s * 1e9))
    stream, detector = feedback.stream.encode(), feedback.detector.encode()
    return _RESTART.pack(2, len(stream), len(detector)) + stream + detector


class FeedbackReader:
    """Takes the bytes in pieces of any size."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Feedback]:
        """The records completed by these bytes. Raises ProtocolError for bytes that are none."""
        self._buffer += data
        records = []
        while (record := self._next()) is not None:
            records.append(record)
        return records

    def _next(self) -> Feedback | None:
        kind = self._buffer[0] if self._buffer else 0
        if kind == 1 and len(self._buffer) >= _READ.size:
            _, total, at_ns = _READ.unpack(self._take(_READ.size))
            return Read(total, at_ns * 1e-9)
        if kind == 2 and len(self._buffer) >= _RESTART.size:
            _, of_stream, of_detector = _RESTART.unpack_from(self._buffer)
            if len(self._buffer) < _RESTART.size + of_stream + of_detector:
                return None
            names = self._take(_RESTART.size + of_stream + of_detector)[_RESTART.size :]
            return Restart(_text(names[:of_stream]), _text(names[of_stream:]))
        if kind not in (0, 1, 2) or (self._buffer and kind == 0):
            raise ProtocolError(f"the receiver of a link sent a record of kind {kind}")
        return None

    def _take(self, nbytes: int) -> bytes:
        taken = bytes(self._buffer[:nbytes])
        del self._buffer[:nbytes]
        return taken


def _text(data: bytes) -> str:
    try:
        return data.decode()
    except UnicodeDecodeError:
        raise ProtocolError(f"the receiver of a link sent a name that is no UTF-8: {data[:40]!r}") from None
