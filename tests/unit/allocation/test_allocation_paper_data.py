"""The shipped data of the paper; its periods are held against the paper's in tests/unit/experiments."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.allocation.build import build_problem
from pipeline.config.inventory import load_inventory
from pipeline.config.pool import Pool, load_pool
from pipeline.config.processing import Processing
from pipeline.experiments.paper_tables import PERIODS

CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.fixture(scope="module")
def pool() -> Pool:
    return load_pool(CONFIGS / "pools" / "paper.yaml")


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
    highlighted = sum(period <= 5 for row in PERIODS.values() for period in row)
    assert len(problem.detectors) == 10 * highlighted
    assert len(problem.machines) == 70
    assert len(problem.bitrates_bps) == 9


def test_what_is_not_printed_is_marked_as_assumed(pool: Pool) -> None:
    assert any(note.startswith("accuracy: shaped after the text") for note in pool.assumed)
    assert any(note.startswith("memory: not printed") for note in pool.assumed)
