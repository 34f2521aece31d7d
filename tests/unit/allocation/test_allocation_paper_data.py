"""The shipped data of the paper, against the paper's own table of periods."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.allocation.build import build_problem, period_of
from pipeline.config.inventory import load_inventory
from pipeline.config.mission import Processing
from pipeline.config.pool import Pool, load_pool

CONFIGS = Path(__file__).parents[3] / "configs"
MACHINES = ("a-cpu", "b-cpu", "c-cpu", "d-cpu", "b-gpu", "c-gpu", "d-gpu")
#: Table ilp_periods
PRINTED_PERIODS = {
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
CELLS = [(net, m, p) for net, row in PRINTED_PERIODS.items() for m, p in zip(MACHINES, row, strict=True)]


@pytest.fixture(scope="module")
def pool() -> Pool:
    return load_pool(CONFIGS / "pools" / "paper.yaml")


@pytest.mark.parametrize(("network", "machine", "printed"), CELLS)
def test_the_mean_times_at_15_hz_give_the_printed_periods(
    pool: Pool, network: str, machine: str, printed: int
) -> None:
    """The table says 30 Hz, but its cells are those of 15 Hz."""
    (detector,) = [d for d in pool.detectors if d.id == network]
    (time,) = [t for t in detector.times if t.machine == machine]
    assert period_of(time.mean, 15.0) == printed


def test_all_cells_of_the_table_are_held() -> None:
    assert len(CELLS) == 70


def test_the_papers_inventory_and_pool_make_a_problem(pool: Pool) -> None:
    inventory = load_inventory(CONFIGS / "inventories" / "paper.yaml")
    processing = Processing.model_validate(
        {
            "frame_rate": {"hertz": 15},
            "max_processing_time": {"seconds": 1},
            "detectors_per_stream": 5,
            "bitrates": [{"kbps": kbps} for kbps in (50, 75, 100, 250, 500, 1000, 2500, 5000, 20000)],
        }
    )
    problem = build_problem({"uav-1": "air"}, processing, inventory, pool, where=Path("paper"))
    highlighted = sum(p <= 5 for _, _, p in CELLS)
    assert len(problem.detectors) == 10 * highlighted
    assert len(problem.machines) == 70
    assert len(problem.bitrates_bps) == 9


def test_what_is_not_printed_is_marked_as_assumed(pool: Pool) -> None:
    assert any(note.startswith("accuracy: shaped after the text") for note in pool.assumed)
    assert any(note.startswith("memory: not printed") for note in pool.assumed)
