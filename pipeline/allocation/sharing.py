"""How detectors that share a machine slow each other down; past the paper, which assumes that they do not."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pipeline.config.pool import PoolDetector
from pipeline.config.processing import Processing
from pipeline.errors import InputError


@dataclass(frozen=True)
class SharingMode:
    """A detector as it is while at most ``detectors`` run on its machine (None: however many); factor: of its
    times. suffix: to tell the modes' ids apart.
    """

    detectors: int | None
    factor: float
    suffix: str


def sharing_modes(processing: Processing, network: PoolDetector, where: Path) -> tuple[SharingMode, ...]:
    """The ways to run a detector: alone, and in every company that the pool has a factor for.

    More detectors than the pool was measured with do not share a machine. Raises InputError for a detector
    without such factors, if the mission asks for them.
    """
    if not processing.sharing:
        return (SharingMode(None, 1.0, ""),)
    if not network.sharing:
        raise InputError(
            f"{where} pool.detectors.{network.id}.sharing",
            "nothing, and processing.sharing is on",
            "the slow-down of 2 and more detectors on one machine, as searchlight evaluate measures it",
        )
    factors = {1: 1.0} | {row.detectors: row.factor for row in network.sharing}
    return tuple(SharingMode(n, factors[n], f"@{n}") for n in sorted(factors))
