"""What the paper prints about its allocation: Tables ilp_periods, ilp_eval1 and ilp_eval2, as printed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pipeline.errors import InputError

#: the columns of Table ilp_periods, as machine types of configs/pools/paper.yaml
MACHINES = ("a-cpu", "b-cpu", "c-cpu", "d-cpu", "b-gpu", "c-gpu", "d-gpu")
#: Table ilp_periods
PERIODS: Mapping[str, tuple[int, ...]] = {
    "faster_rcnn_inception_resnet_v2": (316, 233, 200, 195, 13, 6, 4),
    "faster_rcnn_inception_resnet_v2_lp": (121, 97, 82, 80, 6, 4, 3),
    "faster_rcnn_resnet_101": (53, 38, 32, 31, 2, 2, 2),
    "faster_rcnn_resnet_101_lp": (34, 26, 22, 21, 2, 1, 1),
    "faster_rcnn_resnet_50": (40, 28, 24, 24, 2, 1, 1),
    "faster_rcnn_resnet_50_lp": (21, 16, 14, 13, 1, 1, 1),
    "rfcn_resnet_101": (45, 33, 28, 26, 2, 2, 2),
    "ssd_inception_v2": (2, 2, 2, 2, 1, 1, 1),
    "ssd_mobilenet_v2": (2, 1, 1, 1, 1, 1, 1),
    "ssd_resnet_50_v1": (30, 22, 18, 18, 2, 1, 1),
}
#: |D| and cp_lcm by detPerStream, Table ilp_eval1
DETECTORS = {1: 40, 2: 130, 3: 170, 4: 200, 5: 210}
CYCLE = {1: 1, 2: 2, 3: 6, 4: 12, 5: 60}
#: the longest that the paper waited
LIMIT_S = 600.0

_FEW = "1 2 5 10 15 25 30 40 50"
_MANY = "60 75 100 125 150"
#: table, link in Mbps, |V| of its columns, and by detPerStream the times and below them variables:constraints
_TABLES: tuple[tuple[str, float, str, dict[int, tuple[str, str]]], ...] = (
    (
        "ilp_eval1a",
        1.0,
        _FEW,
        {
            1: (
                "0.1 0.1 0.3 0.7 1.1 1.8 2.1 2.8 3.7",
                "364:91 728:142 2k:295 4k:550 5k:805 9k:1k 11k:2k 15k:2k 18k:3k",
            ),
            2: (
                "0.1 0.3 0.8 2.0 6.6 16.0 24.8 48.4 73.3",
                "1k:223 3k:406 7k:955 13k:2k 20k:3k 33k:5k 39k:6k 52k:7k 65k:9k",
            ),
            3: (
                "0.3 0.7 2.1 6.4 12.0 40.8 56.0 142.4 300.9",
                "2k:911 5k:2k 12k:4k 24k:9k 36k:13k 60k:22k 72k:26k 95k:35k 119k:44k",
            ),
            4: (
                "1.0 1.5 4.8 11.6 26.9 86.5 171.2 >600 >600",
                "4k:2k 8k:4k 20k:11k 40k:22k 60k:33k 100k:54k 120k:65k 160k:87k 200k:109k",
            ),
            5: (
                "4.5 8.6 33.8 169.8 371.6 >600 >600 >600 >600",
                "14k:12k 29k:25k 71k:62k 143k:124k 214k:186k 357k:311k 429k:373k 571k:497k 714k:621k",
            ),
        },
    ),
    (
        "ilp_eval1b",
        20.0,
        _FEW,
        {
            1: (
                "0.1 0.2 0.4 0.8 1.5 2.2 2.7 3.4 4.5",
                "404:91 808:142 2k:295 4k:550 6k:805 10k:1k 12k:2k 16k:2k 20k:3k",
            ),
            2: (
                "0.1 0.3 0.8 1.8 6.1 15.3 26.2 40.2 82.2",
                "1k:223 3k:406 7k:955 14k:2k 22k:3k 36k:5k 43k:6k 57k:7k 72k:9k",
            ),
            3: (
                "0.3 0.8 2.2 4.1 7.4 21.5 38.2 49.0 115.5",
                "3k:911 5k:2k 13k:4k 26k:9k 38k:13k 64k:22k 77k:26k 102k:35k 128k:44k",
            ),
            4: (
                "0.7 1.5 3.6 12.4 18.8 61.2 164.1 >600 >600",
                "4k:2k 8k:4k 21k:11k 42k:22k 63k:33k 105k:54k 126k:65k 168k:87k 210k:109k",
            ),
            5: (
                "49.2 >600 >600 >600 >600 >600 >600 >600 >600",
                "14k:12k 29k:25k 72k:62k 145k:124k 217k:186k 362k:311k 435k:373k 580k:497k 725k:621k",
            ),
        },
    ),
    (
        "ilp_eval2",
        20.0,
        _MANY,
        {
            1: ("6.4 6.8 9.0 61.5* 48.8*", "24k:3k 30k:4k 40k:5k 50k:6k 61k:8k"),
            2: ("115.6 102.2 >600 >600 >600", "86k:11k 108k:14k 143k:18k 179k:23k 215k:27k"),
        },
    ),
)


@dataclass(frozen=True)
class Cell:
    """One cell of Table ilp_eval1 (its two halves are a and b) or ilp_eval2.

    printed: its time as printed, ``>600`` and ``61.5*`` among them; ``*`` says that no solution exists.
    size: ``variables:constraints`` as printed.
    """

    table: str
    link_mbps: float
    detectors_per_stream: int
    streams: int
    printed: str
    size: str

    @property
    def name(self) -> str:
        """Unique, and fit for a file's name."""
        return f"{self.table}-dps{self.detectors_per_stream}-v{self.streams}"

    @property
    def infeasible(self) -> bool:
        """Whether the paper says that no solution exists. What ran into its limit may have one or not."""
        return self.printed.endswith("*")

    @property
    def within_limit(self) -> bool:
        """Whether the paper's solver came to an end within LIMIT_S."""
        return not self.printed.startswith(">")


def _cells() -> tuple[Cell, ...]:
    return tuple(
        Cell(table, mbps, dps, int(streams), time, size)
        for table, mbps, columns, rows in _TABLES
        for dps, (times, sizes) in rows.items()
        for streams, time, size in zip(columns.split(), times.split(), sizes.split(), strict=True)
    )


#: all cells, in the paper's order
CELLS = _cells()


def printed_size(count: int) -> str:
    """A number of variables or constraints as the tables print it: thousands as ``12k``."""
    return str(count) if count < 1000 else f"{count / 1000:.0f}k"


def cells_named(names: Sequence[str]) -> tuple[Cell, ...]:
    """The cells of these names, in the paper's order. Raises InputError for a name that there is not."""
    known = {cell.name for cell in CELLS}
    for name in names:
        if name not in known:
            raise InputError(
                "--cell", repr(name), "TABLE-dpsN-vN as in ilp_eval1a-dps3-v5, a cell of the tables"
            )
    return tuple(cell for cell in CELLS if cell.name in names)
