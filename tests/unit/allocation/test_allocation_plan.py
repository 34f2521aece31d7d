"""Plans as JSON, as a table and as a picture."""

from __future__ import annotations

import json
import math
from collections.abc import Callable

import pytest

from pipeline.allocation import literal
from pipeline.allocation.gantt import gantt, gantt_png
from pipeline.allocation.plan import PLAN_COLUMNS, Plan, plan_from_json, plan_table, plan_to_json
from pipeline.allocation.problem import Problem
from pipeline.errors import InputError


@pytest.fixture
def problem(tiny: Callable[..., Problem]) -> Problem:
    return tiny(("a", 2, 0.8, 2.0), ("b", 2, 0.6, 2.0), link_bps={("v", "s"): math.inf})


@pytest.fixture
def plan(problem: Problem) -> Plan:
    return literal.solve(problem, time_limit_s=30.0)


def test_a_plan_comes_back_from_its_json_equal(problem: Problem, plan: Plan) -> None:
    assert plan_from_json(plan_to_json(plan, problem), "plan.json") == plan


def test_the_json_tells_the_limits_and_writes_no_infinity(problem: Problem, plan: Plan) -> None:
    limits = json.loads(plan_to_json(plan, problem))["problem"]
    assert limits["links"] == [{"stream": "v", "site": "s", "bandwidth_bps": None}]
    assert limits["machines"] == [{"id": "m", "site": "s", "memory_bytes": 1e10}]


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"plan": {"assignments": []}}', '{"plan": 3}'])
def test_a_document_that_is_no_plan_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"plan\.json"):
        plan_from_json(text, "plan.json")


def test_an_unknown_status_is_refused(problem: Problem, plan: Plan) -> None:
    text = plan_to_json(plan, problem).replace('"optimal"', '"fine"')
    with pytest.raises(InputError, match=r"plan\.status: found 'fine'"):
        plan_from_json(text, "plan.json")


def test_the_table_has_a_row_per_assignment_under_its_columns(plan: Plan) -> None:
    rows = plan_table(plan)
    assert [len(row) for row in rows] == [len(PLAN_COLUMNS)] * len(plan.assignments)
    assert rows[0][-2:] == ("4 Mbps", "2 Mbps")


def test_the_picture_marks_each_frame_where_its_detector_starts(problem: Problem, plan: Plan) -> None:
    (axes,) = gantt(problem, plan, cycles=4).axes
    marks = [list(line.get_xdata()) for line in axes.lines]
    assert marks == [[0, 2, 4, 6], [1, 3, 5, 7]]
    bars = [path.get_extents() for collection in axes.collections for path in collection.get_paths()]
    assert {round(bar.width, 6) for bar in bars} == {2.0}  # 0.2 s at 10 Hz


def test_the_picture_is_a_png_even_of_an_empty_plan(problem: Problem) -> None:
    nothing = Plan("infeasible", None, None, None, problem.cycle, (), 0.0, 0, 0)
    assert gantt_png(problem, nothing).startswith(b"\x89PNG")


def test_the_same_plan_gives_the_same_picture(problem: Problem, plan: Plan) -> None:
    assert gantt_png(problem, plan) == gantt_png(problem, plan)
