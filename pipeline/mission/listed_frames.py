"""Detections that somebody else made, as a file lists them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class ListedRow:
    """One box, or a frame that was looked at and shows none (box None).

    where: file and line, or id. stream, file, label: as the file says them, empty if it does not. frame: a
    number; time: seconds or a date, as text. box: x0, y0, x1, y1, pixels of a picture of ``size`` (width,
    height; None: the stream's own). score: 0..1.
    """

    where: str
    stream: str = ""
    frame: int | None = None
    time: str = ""
    file: str = ""
    box: Box | None = None
    score: float = math.nan
    label: str = ""
    size: tuple[float, float] | None = None


@dataclass
class Listing:
    """rows: in any order. pictures: rows of pictures of which nobody said whether they were looked at.

    left_out: reason -> count; first: reason -> where it was met first. assumed: sentences.
    """

    rows: list[ListedRow] = field(default_factory=list)
    pictures: list[ListedRow] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)
    first: dict[str, str] = field(default_factory=dict)
    assumed: list[str] = field(default_factory=list)

    def leave_out(self, reason: str, where: str, count: int = 1) -> None:
        """Count what cannot be used, and remember the first."""
        self.left_out[reason] += count
        self.first.setdefault(reason, where)


def labels(rows: list[ListedRow]) -> Iterator[str]:
    """The labels of all boxes, each once, in order of their first row."""
    yield from dict.fromkeys(row.label for row in rows if row.box is not None)
