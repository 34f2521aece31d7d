"""Table ilp_periods, ours beside the paper's."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.config.pool import Pool, load_pool
from pipeline.errors import InputError
from pipeline.experiments.paper_tables import MACHINES, PERIODS
from pipeline.experiments.periods import period_cells, period_rows

POOL = Path(__file__).parents[3] / "configs" / "pools" / "paper.yaml"


@pytest.fixture(scope="module")
def pool() -> Pool:
    return load_pool(POOL)


def test_all_seventy_periods_are_the_printed_ones(pool: Pool) -> None:
    cells = period_cells(pool, POOL)
    assert len(cells) == 70
    assert [c for c in cells if c.ours != c.printed] == []


def test_a_row_per_network_has_ours_and_the_papers_for_each_machine(pool: Pool) -> None:
    rows = period_rows(period_cells(pool, POOL))
    assert [row[0] for row in rows] == list(PERIODS)
    assert all(len(row) == 1 + len(MACHINES) for row in rows)
    assert rows[0][1] == "316 / 316"


def test_a_period_that_differs_says_so(pool: Pool) -> None:
    first, *others = pool.detectors
    slower = first.times[0].model_copy(update={"mean": 99.0})
    changed = first.model_copy(update={"times": (slower, *first.times[1:])})
    rows = period_rows(period_cells(pool.model_copy(update={"detectors": (changed, *others)}), POOL))
    assert rows[0][1] == "1485 / 316 differs"


def test_a_pool_without_one_of_the_times_is_refused_by_name(pool: Pool) -> None:
    lacking = pool.model_copy(update={"detectors": pool.detectors[1:]})
    with pytest.raises(InputError, match=r"faster_rcnn_inception_resnet_v2 on a-cpu"):
        period_cells(lacking, POOL)
