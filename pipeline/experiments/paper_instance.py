"""The allocation problems behind the cells of the paper's Tables ilp_eval1 and ilp_eval2."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.allocation.build import build_problem
from pipeline.allocation.literal import number_of_constraints, number_of_variables
from pipeline.allocation.problem import Problem
from pipeline.config.inventory import Inventory, Link, load_inventory
from pipeline.config.pool import Pool, load_pool
from pipeline.config.processing import Processing
from pipeline.experiments.paper_tables import Cell

#: B_20; what a link of 1 Mbps cannot carry is left out, which makes B_6
BITRATES_KBPS = (50, 75, 100, 250, 500, 1000, 2500, 5000, 20000)
#: the text says 6 levels for 1 Mbps, the printed numbers of variables need 8
_COUNTED_LEVELS = {1.0: 8, 20.0: 9}
#: a stream's own site; no machine stands there
_AIR = "air"


@dataclass(frozen=True)
class PaperInstance:
    """The 40 machines and their detectors. where: the pool's file, for messages."""

    pool: Pool
    inventory: Inventory
    where: Path

    @property
    def digest(self) -> str:
        """The same for the same content of both files."""
        content = "".join(file.model_dump_json(exclude_defaults=True) for file in (self.pool, self.inventory))
        return hashlib.sha256(content.encode()).hexdigest()

    def problem(self, cell: Cell) -> Problem:
        """The problem of a cell, with the bitrate levels of the text."""
        names = [f"v{number}" for number in range(1, cell.streams + 1)]
        sites = [site.id for site in self.inventory.sites]
        links = tuple(_link(name, site, cell.link_mbps) for name in names for site in sites)
        inventory = self.inventory.model_copy(update={"links": links})
        streams = dict.fromkeys(names, _AIR)
        return build_problem(streams, _processing(cell), inventory, self.pool, where=self.where)

    def printed_size(self, cell: Cell) -> tuple[int, int]:
        """Variables and constraints by the paper's formulas, with as many levels as the table counts."""
        levels = tuple(kbps * 1e3 for kbps in BITRATES_KBPS[: _COUNTED_LEVELS[cell.link_mbps]])
        counted = replace(self.problem(cell), bitrates_bps=levels)
        return number_of_variables(counted), number_of_constraints(counted)


def load_paper_instance(pool: Path, inventory: Path) -> PaperInstance:
    """Read both files; InputError if they cannot be used."""
    return PaperInstance(load_pool(pool), load_inventory(inventory), pool)


def _link(stream: str, site: str, mbps: float) -> Link:
    return Link.model_validate({"stream": stream, "site": site, "bandwidth": {"mbps": mbps}})


def _processing(cell: Cell) -> Processing:
    return Processing.model_validate(
        {
            "frame_rate": {"hertz": 30},
            "max_processing_time": {"seconds": 1},
            "detectors_per_stream": cell.detectors_per_stream,
            "detectors_per_frame": 2,
            "accuracy_weight": 0.6,
            "bitrates": [{"kbps": kbps} for kbps in BITRATES_KBPS],
        }
    )
