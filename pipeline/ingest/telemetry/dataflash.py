"""ArduPilot's dataflash logs: messages that the log itself describes (FMT), each behind the bytes A3 95."""

from __future__ import annotations

import struct
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from pipeline.ingest.samples import LeftOut
from pipeline.messages import FloatArray

HEADER = b"\xa3\x95"
_FMT, _FMT_LENGTH = 0x80, 89
#: character of a layout -> code of struct, and what the number is multiplied by (AP_Logger/LogStructure.h)
_LAYOUT = {
    "a": ("64s", 1.0), "b": ("b", 1.0), "B": ("B", 1.0), "h": ("h", 1.0), "H": ("H", 1.0), "i": ("i", 1.0),
    "I": ("I", 1.0), "f": ("f", 1.0), "d": ("d", 1.0), "g": ("e", 1.0), "n": ("4s", 1.0), "N": ("16s", 1.0),
    "Z": ("64s", 1.0), "c": ("h", 0.01), "C": ("H", 0.01), "e": ("i", 0.01), "E": ("I", 0.01), "L": ("i", 1e-7),
    "M": ("B", 1.0), "q": ("q", 1.0), "Q": ("Q", 1.0),
}  # fmt: skip


@dataclass
class Messages:
    """One kind of message. columns: its fields by name, (N,) each, in the units that the log counts in."""

    columns: dict[str, FloatArray] = field(default_factory=dict)

    def get(self, *names: str) -> FloatArray | None:
        """The first of the fields that there is."""
        return next((self.columns[name] for name in names if name in self.columns), None)


@dataclass
class _Format:
    """A kind of message as FMT lays it out; rows: its unpacked messages, numbers only."""

    name: str
    length: int
    unpack: struct.Struct
    fields: list[str]
    factors: list[float]
    numeric: list[int]
    rows: list[list[float]] = field(default_factory=list)


def messages_of(
    data: bytes, wanted: Collection[str], where: object, left_out: LeftOut
) -> dict[str, Messages]:
    """The wanted kinds of message; damaged bytes are stepped over and counted."""
    formats: dict[int, _Format] = {}
    lengths = {_FMT: _FMT_LENGTH}
    position, size = data.find(HEADER), len(data)
    while 0 <= position <= size - 3:
        number = data[position + 2]
        length = lengths.get(number)
        if data[position : position + 2] != HEADER or length is None:
            left_out.add("damaged", f"{where} byte {position}")
            position = data.find(HEADER, position + 1)
            continue
        if position + length > size:
            left_out.add("cut_off", f"{where} byte {position}")
            break
        if number == _FMT:
            _learn(data[position + 3 : position + length], formats, lengths)
        elif number in formats and formats[number].name in wanted:
            kind = formats[number]
            values = kind.unpack.unpack_from(data, position + 3)
            kind.rows.append([values[i] for i in kind.numeric])
        position += length
    return {kind.name: _columns(kind) for kind in formats.values() if kind.rows}


def _learn(body: bytes, formats: dict[int, _Format], lengths: dict[int, int]) -> None:
    """A kind of message, as its FMT describes it; one that cannot be is not believed."""
    number, length, name, layout, fields = struct.unpack("<BB4s16s64s", body)
    characters = layout.split(b"\0")[0].decode("latin-1")
    names = fields.split(b"\0")[0].decode("latin-1").split(",")
    if number == _FMT or any(c not in _LAYOUT for c in characters) or len(names) != len(characters):
        return
    codes = [_LAYOUT[c] for c in characters]
    unpack = struct.Struct("<" + "".join(code for code, _ in codes))
    if unpack.size + 3 != length:
        return
    # 'a' is an array of 64 bytes, 'n', 'N', 'Z' are text
    numeric = [i for i, (code, _) in enumerate(codes) if "s" not in code]
    lengths[number] = length
    previous = formats.get(number)
    label = name.split(b"\0")[0].decode("latin-1")
    if previous is None or previous.name != label:
        factors = [codes[i][1] for i in numeric]
        formats[number] = _Format(label, length, unpack, [names[i] for i in numeric], factors, numeric)


def _columns(kind: _Format) -> Messages:
    table = np.array(kind.rows, np.float64)
    return Messages(
        {
            name: table[:, i] * factor
            for i, (name, factor) in enumerate(zip(kind.fields, kind.factors, strict=True))
        }
    )
