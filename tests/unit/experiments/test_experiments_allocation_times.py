"""The cells of Tables ilp_eval1 and ilp_eval2: our answers, and what is kept of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.allocation import decomposed
from pipeline.allocation.validate import validate
from pipeline.errors import InputError
from pipeline.experiments import allocation_times
from pipeline.experiments.allocation_report import COLUMNS, summary_lines, table_rows, write_report
from pipeline.experiments.allocation_times import (
    QUICK_CELLS,
    CellResult,
    load_results,
    measure,
    measure_cells,
)
from pipeline.experiments.literal_process import Answer, solve_literal
from pipeline.experiments.paper_instance import PaperInstance
from pipeline.experiments.paper_tables import CELLS, Cell, cells_named

SMALL, TINY = cells_named(["ilp_eval1a-dps1-v2", "ilp_eval1b-dps1-v1"])


def quiet(*_: object) -> None:
    """No progress bar."""


def _check(instance: PaperInstance, cell: Cell) -> None:
    problem = instance.problem(cell)
    plan = decomposed.solve(problem, time_limit_s=60.0)
    assert validate(problem, plan) == []
    assert plan.status == ("infeasible" if cell.infeasible else "optimal")
    assert plan.gap == (None if cell.infeasible else 0.0)


@pytest.mark.parametrize("cell", [c for c in CELLS if c.streams <= 10], ids=lambda cell: cell.name)
def test_a_small_cell_is_solved_to_gap_zero(instance: PaperInstance, cell: Cell) -> None:
    _check(instance, cell)


@pytest.mark.parametrize("streams", [100, 125, 150])
def test_one_detector_each_is_infeasible_from_a_hundred_and_twenty_five_streams_on(
    instance: PaperInstance, streams: int
) -> None:
    (cell,) = cells_named([f"ilp_eval2-dps1-v{streams}"])
    assert cell.infeasible == (streams > 100)
    _check(instance, cell)


@pytest.mark.slow
@pytest.mark.parametrize("cell", [c for c in CELLS if c.streams > 10], ids=lambda cell: cell.name)
def test_a_cell_is_solved_to_gap_zero_or_infeasible_where_the_paper_says_so(
    instance: PaperInstance, cell: Cell
) -> None:
    _check(instance, cell)


def test_ours_and_the_literal_model_in_its_process_agree(instance: PaperInstance) -> None:
    result = measure(instance, SMALL, literal_limit_s=60.0)
    assert (result.same, result.as_the_paper, result.faults) == (True, True, ())
    assert result.speed_up is not None
    assert result.speed_up > 0.0


def test_a_literal_model_that_takes_too_long_is_ended(
    instance: PaperInstance, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half a million variables are not even built by then."""
    monkeypatch.setattr("pipeline.experiments.literal_process._GRACE_S", 0.0)
    (cell,) = cells_named(["ilp_eval1b-dps5-v40"])
    answer = solve_literal(instance.problem(cell), 0.3)
    assert (answer.status, answer.objective, answer.cpu_seconds) == ("unknown", None, None)
    assert answer.seconds < 30.0


def test_what_is_measured_is_not_measured_again(
    instance: PaperInstance, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured: list[str] = []

    def counted(instance: PaperInstance, cell: Cell, literal_limit_s: float) -> CellResult:
        measured.append(cell.name)
        return measure(instance, cell, literal_limit_s)

    monkeypatch.setattr(allocation_times, "measure", counted)
    measure_cells(instance, [TINY], tmp_path, 0.0, quiet)
    measure_cells(instance, [SMALL, TINY], tmp_path, 0.0, quiet)
    assert measured == [TINY.name, SMALL.name]
    measure_cells(instance, [TINY], tmp_path, 20.0, quiet)
    assert measured[2:] == [TINY.name]
    measure_cells(instance, [TINY], tmp_path, 30.0, quiet)
    assert len(measured) == 3, "the literal model came to an end: a longer limit adds nothing"


def test_results_come_back_as_they_were_and_only_for_the_same_machines(
    instance: PaperInstance, tmp_path: Path
) -> None:
    measure_cells(instance, [SMALL], tmp_path, 0.0, quiet)
    (result,) = load_results(instance, tmp_path)
    stored = json.loads((tmp_path / "cells" / f"{SMALL.name}.json").read_bytes())["result"]
    assert result.cell == SMALL
    assert result.ours == Answer(**stored["ours"])
    other = replace(instance, pool=instance.pool.model_copy(update={"assumed": ()}))
    assert load_results(other, tmp_path) == []


def test_a_spoiled_result_is_refused_by_name(instance: PaperInstance, tmp_path: Path) -> None:
    (tmp_path / "cells").mkdir()
    (tmp_path / "cells" / f"{SMALL.name}.json").write_text("[", encoding="utf-8")
    with pytest.raises(InputError, match=rf"{SMALL.name}\.json"):
        load_results(instance, tmp_path)


def test_the_quick_cells_are_few_and_small() -> None:
    assert len(QUICK_CELLS) == 12
    assert all(cell.streams <= 2 for cell in QUICK_CELLS)


def _result(cell: Cell, ours: Answer, literal: Answer | None) -> CellResult:
    return CellResult(cell, (364, 91), ours, (3, 5), (), literal, 120.0)


def test_the_table_says_what_was_found(tmp_path: Path) -> None:
    ours = Answer("optimal", -0.13, 0.0, 0.05, 0.02)
    done = _result(TINY, ours, Answer("optimal", -0.13, 0.0, 70.0, 60.0))
    differs = _result(TINY, ours, Answer("optimal", -0.12, 0.0, 70.0, 60.0))
    ended = _result(TINY, ours, Answer("feasible", -0.2, 0.1, 121.0, 119.0))
    (row,) = table_rows([done], TINY.table)
    assert len(row) == len(COLUMNS)
    assert row[2:9] == ("0.1", "70.0", "60.0", "0.050", "0.020", "3000", "optimal")
    assert (done.same, differs.same, ended.same) == (True, False, None)
    assert table_rows([differs], TINY.table)[0][10] == "NO"
    assert table_rows([ended], TINY.table)[0][3] == ">120"
    assert any("least speed-up of the 1 cells" in line and "3000" in line for line in summary_lines([done]))
    write_report(tmp_path, [done])
    assert "| 0.1 | 70.0 | 60.0 |" in (tmp_path / "report.md").read_text(encoding="utf-8")
    assert json.loads((tmp_path / "results.json").read_bytes())["cells"][0]["speed_up"] == pytest.approx(3000)


def test_an_answer_that_contradicts_the_paper_counts_as_such() -> None:
    infeasible = Answer("infeasible", None, None, 0.05, 0.02)
    assert _result(TINY, infeasible, None).as_the_paper is False
    (starred, open_cell) = cells_named(["ilp_eval1b-dps5-v2", "ilp_eval2-dps1-v125"])[::-1]
    assert _result(starred, infeasible, None).as_the_paper is True
    assert _result(open_cell, infeasible, None).as_the_paper is None
