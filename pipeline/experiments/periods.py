"""Table ilp_periods: the periods of the paper's networks on its machines, its own beside ours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.allocation.build import period_of
from pipeline.config.pool import Pool
from pipeline.errors import InputError
from pipeline.experiments.paper_tables import MACHINES, PERIODS

#: the table says 30, its cells are those of 15
FRAME_RATE_HZ = 15.0


@dataclass(frozen=True)
class PeriodCell:
    """One network on one machine type. printed: the paper's period. ours: by Eq. period of the mean time."""

    network: str
    machine: str
    printed: int
    ours: int


def period_cells(pool: Pool, where: Path) -> list[PeriodCell]:
    """All 70 cells, row by row. Raises InputError, naming the pool's file, if it lacks one of the times."""
    means = {(d.id, time.machine): time.mean for d in pool.detectors for time in d.times}
    missing = [(n, m) for n in PERIODS for m in MACHINES if (n, m) not in means]
    if missing:
        network, machine = missing[0]
        raise InputError(where, f"no time of {network} on {machine}", "the times of configs/pools/paper.yaml")
    return [
        PeriodCell(network, machine, printed, period_of(means[network, machine], FRAME_RATE_HZ))
        for network, row in PERIODS.items()
        for machine, printed in zip(MACHINES, row, strict=True)
    ]


def period_rows(cells: Sequence[PeriodCell]) -> list[tuple[str, ...]]:
    """One row of text per network: its name, then ``ours / printed`` per machine type."""
    texts = {(c.network, c.machine): _text(c) for c in cells}
    return [(network, *(texts[network, machine] for machine in MACHINES)) for network in PERIODS]


def _text(cell: PeriodCell) -> str:
    return f"{cell.ours} / {cell.printed}" + ("" if cell.ours == cell.printed else " differs")
