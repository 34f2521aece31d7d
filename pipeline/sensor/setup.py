"""A setup: one network as it is run on one kind of machine. What was measured, planned with, and opened.

The same record goes from the row of the pool through the plan to the session.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.config.pool import PoolDetector, TimeOn


@dataclass(frozen=True)
class Tiling:
    """width, height: of a tile in pixels of the picture. overlap: of neighbours, a share of a tile, 0..0.9.
    whole: one more pass over the whole picture.
    """

    width: int
    height: int
    overlap: float
    whole: bool


@dataclass(frozen=True)
class Setup:
    """model: its file's name. sha256: of the file, empty where the pool states none. precision: stated.

    input_size: width and height for networks that leave it free; None: the model's. tiling: None: one pass
    over the whole picture.
    """

    model: str = ""
    sha256: str = ""
    provider: str = "cpu"
    threads: int = 1
    precision: str = ""
    input_size: tuple[int, int] | None = None
    tiling: Tiling | None = None


#: one pass over the whole picture on one thread of a processor
PLAIN = Setup()


def setup_of(detector: PoolDetector, time: TimeOn | None = None) -> Setup:
    """A row of the pool on the machine of one of its times; without one: one thread of a processor."""
    tiles = detector.tiles
    return Setup(
        model="" if detector.model is None else detector.model.name,
        sha256=detector.sha256 or "",
        provider=(time.provider if time is not None else None) or "cpu",
        threads=(time.threads if time is not None else None) or 1,
        precision=detector.precision or "",
        input_size=detector.input_size,
        tiling=None if tiles is None else Tiling(*tiles.size, tiles.overlap, tiles.whole),
    )


def setup_from(record: Mapping[str, Any]) -> Setup:
    """The setup of a record as ``dataclasses.asdict`` makes it. Raises TypeError for another one."""
    fields = dict(record)
    size, tiling = fields.pop("input_size", None), fields.pop("tiling", None)
    return Setup(
        **fields,
        input_size=None if size is None else (int(size[0]), int(size[1])),
        tiling=None if tiling is None else Tiling(**tiling),
    )
