"""The wire form of ONNX (protocol buffers: https://protobuf.dev/programming-guides/encoding).

The package that knows ONNX's schema costs 0.15 s of every start; two things are needed of it.
"""

from __future__ import annotations

from collections.abc import Iterator

BYTES = 2
_FIXED = {1: 8, 5: 4}


def fields(message: bytes) -> Iterator[tuple[int, bytes | None, bytes]]:
    """Of each field: its number, its content if that is bytes, and all of it as it stands."""
    at = 0
    while at < len(message):
        start = at
        key, at = read_varint(message, at)
        kind = key & 7
        content = None
        if kind == 0:
            _, at = read_varint(message, at)
        elif kind in _FIXED:
            at += _FIXED[kind]
        elif kind == BYTES:
            length, at = read_varint(message, at)
            content, at = message[at : at + length], at + length
        else:
            raise ValueError(f"wire type {kind}")
        if at > len(message):
            raise ValueError("a field that is cut off")
        yield key >> 3, content, message[start:at]


def read_varint(message: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        if at >= len(message) or shift > 63:
            raise ValueError("a number that is cut off")
        byte = message[at]
        value |= (byte & 127) << shift
        at, shift = at + 1, shift + 7
        if byte < 128:
            return value, at
