"""The printed tables agree with themselves, and their sizes with the paper's formulas."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import pytest

from pipeline.errors import InputError
from pipeline.experiments.paper_instance import PaperInstance
from pipeline.experiments.paper_tables import CELLS, CYCLE, DETECTORS, Cell, cells_named, printed_size


def test_the_tables_have_a_hundred_cells_nineteen_of_them_over_the_limit_and_two_infeasible() -> None:
    assert Counter(cell.table for cell in CELLS) == {"ilp_eval1a": 45, "ilp_eval1b": 45, "ilp_eval2": 10}
    assert sum(not cell.within_limit for cell in CELLS) == 19
    assert [cell.name for cell in CELLS if cell.infeasible] == ["ilp_eval2-dps1-v125", "ilp_eval2-dps1-v150"]
    assert len({cell.name for cell in CELLS}) == 100


def test_every_printed_time_is_a_number_of_seconds() -> None:
    assert all(float(cell.printed.strip(">*")) > 0.0 for cell in CELLS)


def test_printed_sizes_grow_with_the_streams_and_with_the_detectors_per_stream() -> None:
    """Of one table, since a misread row or column would break it."""
    by_row = {(c.table, c.detectors_per_stream, c.streams): _variables(c) for c in CELLS}
    for (table, dps, streams), variables in by_row.items():
        row = [v for (t, d, s), v in by_row.items() if (t, d) == (table, dps) and s < streams]
        column = [v for (t, d, s), v in by_row.items() if (t, s) == (table, streams) and d < dps]
        assert all(less < variables for less in row + column)


def _variables(cell: Cell) -> int:
    return int(cell.size.split(":")[0].replace("k", "000"))


@pytest.mark.parametrize("cell", CELLS, ids=lambda cell: cell.name)
def test_the_printed_size_is_that_of_the_formulas(instance: PaperInstance, cell: Cell) -> None:
    """With 8 bitrate levels at 1 Mbps, where the text has 6."""
    variables, constraints = instance.printed_size(cell)
    assert f"{printed_size(variables)}:{printed_size(constraints)}" == cell.size


def test_six_levels_at_one_mbps_would_not_give_the_printed_variables(instance: PaperInstance) -> None:
    (cell,) = cells_named(["ilp_eval1a-dps1-v1"])
    problem = instance.problem(cell)
    assert len(problem.bitrates_bps) == 6
    assert len(problem.detectors) * (6 + problem.cycle) + len(problem.sites) == 284
    assert cell.size.startswith("364:")


@pytest.mark.parametrize("detectors_per_stream", DETECTORS)
def test_the_shipped_machines_offer_the_printed_detectors_and_cycle(
    instance: PaperInstance, detectors_per_stream: int
) -> None:
    (cell,) = cells_named([f"ilp_eval1b-dps{detectors_per_stream}-v1"])
    problem = instance.problem(cell)
    assert len(problem.machines) == 40
    assert len(problem.sites) == 4
    assert len(problem.detectors) == DETECTORS[detectors_per_stream]
    assert problem.cycle == CYCLE[detectors_per_stream]


def test_the_periods_are_those_that_the_counts_of_constraints_need(instance: PaperInstance) -> None:
    """Notes on the paper, number 2."""
    (cell,) = cells_named(["ilp_eval1b-dps5-v1"])
    periods = Counter(d.period for d in instance.problem(cell).detectors)
    assert periods == {1: 40, 2: 90, 3: 40, 4: 30, 5: 10}


def test_what_is_not_printed_is_marked_as_assumed(instance: PaperInstance) -> None:
    for what in ("maxima", "memory", "accuracy", "ssd_mobilenet_v2_cpu"):
        assert any(note.startswith(f"{what}:") for note in instance.pool.assumed)


def test_levels_above_the_link_are_left_out(instance: PaperInstance) -> None:
    few, many = (instance.problem(c) for c in cells_named(["ilp_eval1a-dps1-v1", "ilp_eval1b-dps1-v1"]))
    assert few.bitrates_bps == (50e3, 75e3, 100e3, 250e3, 500e3, 1e6)
    assert many.bitrates_bps == (*few.bitrates_bps, 2.5e6, 5e6, 20e6)


def test_accuracies_do_not_fall_with_the_bitrate(instance: PaperInstance) -> None:
    (cell,) = cells_named(["ilp_eval1b-dps5-v1"])
    for detector in instance.problem(cell).detectors:
        assert all(low <= high for low, high in pairwise(detector.accuracy))


def test_sizes_are_printed_in_thousands_from_a_thousand_on() -> None:
    assert [printed_size(n) for n in (91, 999, 1060, 14284, 714200)] == ["91", "999", "1k", "14k", "714k"]


def test_a_cell_that_there_is_not_is_refused_by_name() -> None:
    with pytest.raises(InputError, match="ilp_eval1a-dps6-v1"):
        cells_named(["ilp_eval1a-dps1-v1", "ilp_eval1a-dps6-v1"])
