"""What travels in a rehearsal."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.mission.controller.substreams import Substream


@dataclass(frozen=True)
class SentFrame:
    """A packet: the frame of one tick for one substream. bits: on the link. key: it stands alone."""

    substream: Substream
    sequence: int
    tick: int
    key: bool
    bits: float


@dataclass(frozen=True)
class SentEnd:
    """The end of a substream. sequence: how many packets came before it."""

    substream: Substream
    sequence: int
    bits: float = 256.0


@dataclass(frozen=True)
class Result:
    """What became of a packet on its machine. dropped: why it was not looked at, or None."""

    substream: Substream
    sequence: int
    tick: int
    dropped: str | None = None


@dataclass(frozen=True)
class ResultEnd:
    """A machine has passed on all results of a substream."""

    substream: Substream
    sequence: int
