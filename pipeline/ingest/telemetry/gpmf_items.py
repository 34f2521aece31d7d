"""GoPro's metadata format GPMF: items of a four-letter key, a type, a size and a count, nested where the type is 0.

https://github.com/gopro/gpmf-parser describes it. Read here, not by py-gpmf-parser: that one has no wheels for
Python 3.13, for other systems than Linux, and reads no bare GPMF.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.messages import FloatArray

#: type -> big-endian format of numpy
_NUMBERS = {
    "b": ">i1", "B": ">u1", "s": ">i2", "S": ">u2", "l": ">i4", "L": ">u4", "f": ">f4", "d": ">f8",
    "j": ">i8", "J": ">u8",
}  # fmt: skip
_DEEPEST = 8


@dataclass(frozen=True, slots=True)
class Item:
    """key: four letters. kind: its type, ``\\0`` for a nest. size: bytes of one of its ``count`` elements."""

    key: str
    kind: str
    size: int
    count: int
    data: bytes

    def text(self) -> str:
        """Of a text or a date."""
        return self.data.split(b"\0")[0].decode("latin-1").strip()

    def table(self, types: str = "") -> FloatArray:
        """Rows of numbers (count, fields), float64; none for what is no number. types: of kind ``?``."""
        kinds = types if self.kind == "?" else self.kind
        if self.count == 0 or not kinds or any(kind not in _NUMBERS for kind in kinds):
            return np.zeros((0, 0))
        if len(kinds) == 1:
            kinds *= max(1, self.size // np.dtype(_NUMBERS[kinds]).itemsize)
        layout = np.dtype([(f"f{i}", _NUMBERS[kind]) for i, kind in enumerate(kinds)])
        if layout.itemsize != self.size or len(self.data) != self.size * self.count:
            return np.zeros((0, 0))
        rows = np.frombuffer(self.data, layout)
        return np.stack([rows[name].astype(np.float64) for name in layout.names or ()], axis=1)


def items_of(data: bytes) -> Iterator[Item]:
    """The items in a run of bytes, not those inside of nests; it ends where the bytes do not make sense."""
    position = 0
    while position + 8 <= len(data):
        key, kind, size, count = struct.unpack_from(">4scBH", data, position)
        length = size * count
        if not key.strip(b"\0") or not all(32 <= c < 127 for c in key) or position + 8 + length > len(data):
            return
        yield Item(
            key.decode("ascii"),
            kind.decode("latin-1"),
            size,
            count,
            data[position + 8 : position + 8 + length],
        )
        position += 8 + -(-length // 4) * 4


def nests_of(data: bytes, key: str, depth: int = 0) -> Iterator[list[Item]]:
    """The contents of every nest of a key, however deep."""
    for item in items_of(data):
        if item.kind != "\0" or depth > _DEEPEST:
            continue
        if item.key == key:
            yield list(items_of(item.data))
        else:
            yield from nests_of(item.data, key, depth + 1)


def scale_of(items: list[Item]) -> FloatArray:
    """What the numbers of a stream are divided by (SCAL), one value or one per field; NaN for a 0."""
    item = next((item for item in items if item.key == "SCAL"), None)
    values = np.ones(1) if item is None else item.table().ravel()
    return np.where(values == 0.0, math.nan, values) if len(values) else np.ones(1)
