"""``searchlight experiment periods`` and ``allocation``, as they are called."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from actors.cli import app
from pipeline.errors import InputError

ROOT = Path(__file__).parents[3]


@pytest.fixture(autouse=True)
def _at_the_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def test_periods_prints_all_cells() -> None:
    result = CliRunner().invoke(app, ["experiment", "periods"])
    assert result.exit_code == 0
    assert "70 of 70 cells equal" in result.output


def test_allocation_writes_a_report_of_the_cells_asked_for(tmp_path: Path) -> None:
    named = ["--cell", "ilp_eval1a-dps1-v1", "--cell", "ilp_eval2-dps1-v125"]
    out = tmp_path / "new" / "folder"
    result = CliRunner().invoke(
        app, ["experiment", "allocation", "--out", str(out), "--literal-limit", "0", *named]
    )
    assert result.exit_code == 0, result.output
    assert "2 of 100 cells: 1 optimal with gap 0, 1 infeasible" in result.output
    cells = json.loads((out / "results.json").read_bytes())["cells"]
    assert [c["cell"]["size"] for c in cells] == ["364:91", "50k:6k"]
    assert "Table ilp_eval2" in (out / "report.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--literal-limit", "nan"], "--literal-limit"),
        (["--literal-limit", "-1"], "--literal-limit"),
        (["--cell", "ilp_eval9"], "ilp_eval9"),
        (["--pool", "nowhere.yaml"], "nowhere.yaml"),
    ],
)
def test_bad_input_is_named_and_nothing_is_written(tmp_path: Path, arguments: list[str], named: str) -> None:
    out = tmp_path / "out"
    result = CliRunner().invoke(app, ["experiment", "allocation", "--out", str(out), *arguments])
    assert isinstance(result.exception, InputError)
    assert named in str(result.exception)
    assert not out.exists()
