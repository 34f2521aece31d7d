"""What is no message is refused before it has cost time: how many values it holds and how deep is bounded."""

from __future__ import annotations

import struct
import time

import pytest

from pipeline.errors import ProtocolError
from pipeline.messages import MAX_MESSAGE_BYTES, EndOfStream, pack, unpack

_MOST = MAX_MESSAGE_BYTES - 16


def _tree(depth: int, leaf: bytes, head: bytes, key: bytes = b"") -> bytes:
    """Containers of 15 that hold containers of 15, and so on: each is short."""
    data = leaf
    for _ in range(depth):
        data = head + (key + data) * 15
    return data


HOSTILE = {
    "empty arrays": b"\xdd" + struct.pack(">I", _MOST) + b"\x90" * _MOST,
    "empty arrays in a known message": b"\x92\x00\xdd" + struct.pack(">I", _MOST) + b"\x90" * _MOST,
    "numbers": b"\xdd" + struct.pack(">I", _MOST) + b"\x01" * _MOST,
    "a tree of short arrays": _tree(5, b"\x90", b"\x9f"),
    "a tree of short maps": _tree(5, b"\x80", b"\x8f", b"\x01"),
    "arrays in arrays": b"\x91" * _MOST,
    "pairs": b"\xdf" + struct.pack(">I", _MOST // 2) + b"\x01" * _MOST,
    "an array that is not there": b"\xdd\xff\xff\xff\xff",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_refused_at_once(name: str) -> None:
    began_s = time.process_time()
    with pytest.raises(ProtocolError):
        unpack(HOSTILE[name])
    assert time.process_time() - began_s < 0.1


def test_what_is_a_message_still_passes() -> None:
    assert unpack(pack(EndOfStream("a", "b", 1, 2))) == EndOfStream("a", "b", 1, 2)
