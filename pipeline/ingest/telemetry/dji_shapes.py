"""Reading many cues that differ in their numbers only: an hour has a hundred thousand, of a few shapes.

The first cue of a shape is read as ``fields_of`` reads it and makes a pattern, which reads the others to the same
values several times faster. Only ``[key: value]`` cues have one; whatever fits no pattern is read in full.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from pipeline.ingest.telemetry.dji_fields import KEY_VALUE, altitude_by_kind, field_name, fields_of, reading
from pipeline.ingest.telemetry.dji_position import GpsOrder

_DECIMAL = re.compile(r"[-+]?\d+\.\d+")
_DIGITS = re.compile(r"\d+")
#: of what is not written as key and value
_OTHER_WORDS = ("GPS", "RTK", "PRY", "DZOOM", "BAROMETER", "Hb", "H ", "H:", "H=")
#: a file of more shapes is read in full
_MOST_SHAPES = 32


@dataclass(frozen=True, slots=True)
class _Shape:
    """pattern: of a whole cue, a group for each of names. same: fields that stand in the pattern as they are."""

    pattern: re.Pattern[str]
    names: tuple[str, ...]
    same: dict[str, float]


class CueReader:
    """``fields_of``, remembering the shapes of the cues before."""

    def __init__(self, order: GpsOrder | None) -> None:
        self._order = order
        self._shapes: list[_Shape] = []
        self._made = 0

    def fields(self, text: str) -> tuple[dict[str, float], list[str]]:
        """As ``fields_of``."""
        for place, shape in enumerate(self._shapes):
            match = shape.pattern.fullmatch(text)
            if match is None:
                continue
            if place:
                self._shapes.insert(0, self._shapes.pop(place))
            fields = shape.same | dict(zip(shape.names, map(float, match.groups()), strict=True))
            return fields, altitude_by_kind(fields)
        if self._made < _MOST_SHAPES:
            self._made += 1
            made = _shape_of(text)
            if made is not None:
                self._shapes.insert(0, made)
        return fields_of(text, self._order)


def _shape_of(text: str) -> _Shape | None:
    """The shape of a cue; None if it is not of keys and values alone, or names one twice."""
    if any(word in text for word in _OTHER_WORDS):
        return None
    parts: list[str] = []
    names: list[str] = []
    same: dict[str, float] = {}
    position = 0
    for match in KEY_VALUE.finditer(text):
        name = field_name(match.group(1))
        if name is None:
            continue
        if name in names or name in same:
            return None
        parts.append(_any_digits(text[position : match.start(2)]))
        position = match.end()
        # numbers without a point stay: a focal length of 240 is read by another rule than one of 24.0
        if _DECIMAL.fullmatch(match.group(2)) and not match.group(3) and name != "digital_zoom":
            parts.append(r"([-+]?\d+\.\d+)")
            names.append(name)
        else:
            parts.append(re.escape(text[match.start(2) : position]))
            same[name] = reading(name, match.group(2), match.group(3))
    parts.append(_any_digits(text[position:]))
    return _Shape(re.compile("".join(parts)), tuple(names), same)


def _any_digits(text: str) -> str:
    return r"\d+".join(re.escape(part) for part in _DIGITS.split(text))
