"""A substream has an identity of its own each time it is opened."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

from pipeline.allocation.plan import Assignment


@dataclass(frozen=True, order=True)
class Substream:
    """The packets of one stream for one detector, since the epoch at which it was opened.

    Its packets are numbered from 0 and its first one stands alone. It is opened and closed once: the same stream on
    the same detector later is another substream.
    """

    stream: str
    detector: str
    epoch: int

    @property
    def instance(self) -> tuple[str, str]:
        """What has memory on the machine: the network of a stream, whatever the epoch."""
        return self.stream, self.detector


@dataclass(frozen=True)
class Opened:
    """A substream and how it is looked at. epoch: at which it was opened."""

    epoch: int
    assignment: Assignment

    @cached_property
    def key(self) -> Substream:
        """Its identity."""
        return Substream(self.assignment.stream, self.assignment.detector, self.epoch)

    @property
    def machine(self) -> str:
        """Where it is looked at."""
        return self.assignment.machine

    def goes_on_as(self, other: Assignment) -> bool:
        """Whether neither encoder nor decoder nor detector would notice; only the phase may be another."""
        return _all_but_phase(self.assignment) == _all_but_phase(other)


@dataclass(frozen=True)
class PlanEpoch:
    """What one stream is looked at by, from one of its ticks on.

    number: of the epoch, ascending for each stream. substreams: ordered by phase and detector.
    """

    stream: str
    number: int
    substreams: tuple[Opened, ...] = ()

    @cached_property
    def keys(self) -> frozenset[Substream]:
        """The identities of its substreams."""
        return keys_of(self.substreams)


def keys_of(substreams: Iterable[Opened]) -> frozenset[Substream]:
    """The identities of substreams."""
    return frozenset(opened.key for opened in substreams)


def _all_but_phase(a: Assignment) -> tuple[object, ...]:
    return a.stream, a.detector, a.pool_detector, a.period, a.bitrate_bps, a.codec, a.setup
