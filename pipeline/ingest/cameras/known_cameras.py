"""Cameras that are known by the name in the metadata: their focal length, how sure it is, and where it is from.

A camera is known by its exact name or not at all: a Mini 3 is no Mini 3 Pro.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Annotated

from pydantic import Field

from pipeline.config.base import Strict, load
from pipeline.errors import InputError

Share = Annotated[float, Field(gt=0.0, lt=1.0)]
Size = tuple[int, int]

_FILE = Path(__file__).with_name("known_cameras.yaml")
_MAKERS = ("dji", "hasselblad")
#: a focal length in the metadata that differs by less is that of a lens at its widest
SAME_FOCAL = 0.06


class KnownCamera(Strict):
    """A row of the list; the file's head says what each key means."""

    camera: str
    names: tuple[str, ...] = Field(min_length=1)
    stills: Size
    equivalent: float = Field(gt=0.0)
    focal_over_width: float = Field(gt=0.2, lt=20.0)
    focal_sd: Share
    source: str = Field(min_length=10)
    only: tuple[Size, ...] = ()
    shares_name: bool = False
    zoom: bool = False
    video_sd: Share | None = None

    def is_widest(self, focal_mm: float) -> bool:
        """Whether an equivalent focal length, millimetres, is this lens's at its widest."""
        return abs(focal_mm / self.equivalent - 1.0) < SAME_FOCAL


class _List(Strict):
    cameras: tuple[KnownCamera, ...]


@cache
def known_cameras() -> tuple[KnownCamera, ...]:
    """The whole list."""
    return load(_FILE, _List).cameras


def find_camera(
    names: Sequence[str], size: Size, focal_mm: float, where: str, expected: str
) -> KnownCamera | None:
    """The camera that is called so, None if none is known.

    size: of the pictures. focal_mm: the least equivalent one in the metadata, 0 if they have none. where, expected:
    for an InputError, which is raised if the name is that of several lenses and nothing tells which.
    """
    for name in names:
        rows = [row for row in known_cameras() if _key(name) in map(_key, row.names)]
        by_size = [row for row in rows if size in row.only]
        rows = by_size or [row for row in rows if not row.only]
        if not rows:
            continue
        if by_size:
            return rows[0]
        told = [row for row in rows if focal_mm and (row.zoom or row.is_widest(focal_mm))]
        if told:
            return told[0]
        row = rows[0]
        if row.zoom or row.shares_name:
            if focal_mm:
                return None  # another lens of that name: its own focal length is all that is known
            what = "zooms" if row.zoom else "is one of several of that name"
            raise InputError(
                f"{where} camera",
                f"a camera called {name[:60]!r}, which {what}, and no focal length",
                expected,
            )
        return row
    return None


def _key(name: str) -> str:
    """A name without case, blanks and signs, and without its maker."""
    words = re.findall(r"[a-z0-9+]+", name.lower())
    return "".join(words[1:] if len(words) > 1 and words[0] in _MAKERS else words)
