"""searchlight allocate: from a problem file to a plan, and what it says where there is none."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from actors.cli import main

INVENTORY = """\
sites:
  - id: van
    machines: [{id: m, type: cpu, memory: {gigabytes: 4}, count: 2}]
links: [{stream: uav, site: van, bandwidth: {mbps: 5}}]
"""
POOL = """\
detectors:
  - id: net
    memory: {gigabytes: 1}
    accuracy: [{bitrate: {mbps: 1}, accuracy: 0.5}, {bitrate: {mbps: 4}, accuracy: 0.8}]
    times: [{machine: cpu, mean: {milliseconds: 80}}]
"""
PROBLEM = """\
streams: [{id: uav, site: air, count: 3}]
inventory: inventory.yaml
pool: pool.yaml
processing:
  frame_rate: {hertz: 10}
  max_processing_time: {seconds: 1}
  bitrates: [{mbps: 1}, {mbps: 4}]
"""


@pytest.fixture
def problem(tmp_path: Path) -> Path:
    (tmp_path / "inventory.yaml").write_text(INVENTORY)
    (tmp_path / "pool.yaml").write_text(POOL)
    (tmp_path / "problem.yaml").write_text(PROBLEM)
    return tmp_path / "problem.yaml"


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr("sys.argv", ["searchlight", "allocate", *map(str, arguments)])
    try:
        main()
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


def change(problem: Path, file: str, old: str, new: str) -> None:
    path = problem.with_name(file)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.mark.parametrize("model", ["literal", "decomposed"])
def test_both_models_print_the_same_plan_as_json(
    problem: Path, model: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, problem, "--model", model, "--json") == 0
    plan = json.loads(capsys.readouterr().out)["plan"]
    assert plan["status"] == "optimal"
    # 5 Mbps carry each stream twice: at 4 Mbps with accuracy 0.8, and at 1 Mbps (a quarter) with 0.5
    assert plan["objective"] == pytest.approx(3 * (0.6 * (0.8 + 0.25 * 0.5) - 0.4))
    assert {a["stream"] for a in plan["assignments"]} == {"uav", "uav-2", "uav-3"}


def test_a_plan_is_written_and_planned_again_from(
    problem: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, problem, "--out", tmp_path / "out") == 0
    assert (tmp_path / "out" / "schedule.png").read_bytes().startswith(b"\x89PNG")
    assert run(monkeypatch, problem, "--running", tmp_path / "out" / "plan.json") == 0
    said = capsys.readouterr().err.replace("\n", " ")
    assert "3 of 3 streams served (proven); 6 substreams go on, 0 end, 0 begin" in said


def test_a_stream_that_can_no_longer_be_served_is_named_and_the_others_are_planned_again(
    problem: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    change(problem, "problem.yaml", "count: 3}]", "count: 2}, {id: far, site: air}]")
    change(problem, "inventory.yaml", "links: [", "links: [{stream: far, site: van, bandwidth: {mbps: 5}}, ")
    assert run(monkeypatch, problem, "--out", tmp_path / "out") == 0
    change(
        problem,
        "inventory.yaml",
        "far, site: van, bandwidth: {mbps: 5}",
        "far, site: van, bandwidth: {mbps: 0.2}",
    )
    again = ("--running", tmp_path / "out" / "plan.json", "--out", tmp_path / "again")
    assert run(monkeypatch, problem, *again) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "2 of 3 streams served (proven); 4 substreams go on, 2 end, 0 begin" in said
    assert (
        "stream far is not served: its links carry too little (0.2 Mbps to van; the least level is 1" in said
    )
    document = json.loads((tmp_path / "again" / "plan.json").read_text())
    assert document["problem"]["streams"] == ["uav", "uav-2"]
    change(problem, "pool.yaml", "gigabytes: 1", "gigabytes: 5")
    assert run(monkeypatch, problem, "--running", tmp_path / "out" / "plan.json") == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "no stream can be served: stream uav: the machines that it reaches have not the memory" in said


@pytest.mark.parametrize(("priority", "left_out"), [(5, "uav"), (-5, "far")])
def test_the_lowest_priority_is_left_out_first_when_the_machines_get_too_few(
    priority: int,
    left_out: str,
    problem: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    change(
        problem, "problem.yaml", "count: 3}]", f"count: 1}}, {{id: far, site: air, priority: {priority}}}]"
    )
    change(problem, "inventory.yaml", "links: [", "links: [{stream: far, site: van, bandwidth: {mbps: 5}}, ")
    assert run(monkeypatch, problem, "--out", tmp_path / "out") == 0
    change(problem, "inventory.yaml", "gigabytes: 4}, count: 2", "gigabytes: 1}, count: 1")
    assert run(monkeypatch, problem, "--running", tmp_path / "out" / "plan.json") == 0
    said = " ".join(capsys.readouterr().err.split())
    assert f"stream {left_out} is not served: the machines are full with the 1 streams served" in said


def test_a_problem_without_a_plan_names_the_limits_and_the_change_that_is_enough(
    problem: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    change(problem, "inventory.yaml", "mbps: 5", "kbps: 200")
    change(problem, "problem.yaml", "[{mbps: 1}, {mbps: 4}]", "[{kbps: 150}, {mbps: 1}]")
    change(problem, "inventory.yaml", "kbps: 200", "kbps: 160")
    change(problem, "inventory.yaml", "gigabytes: 4", "gigabytes: 1")
    assert run(monkeypatch, problem, "--out", tmp_path / "out") == 2
    said = capsys.readouterr().err
    assert "these limits cannot hold together: the memory of machine m (1 GB)" in said
    assert "enough by itself: 2 GB on machine m" in said
    assert not (tmp_path / "out").exists()


def test_a_time_limit_before_any_plan_is_exit_code_3_and_no_file(
    problem: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    change(problem, "problem.yaml", "count: 3", "count: 8")
    assert (
        run(monkeypatch, problem, "--model", "literal", "--time-limit", "0.001", "--out", tmp_path / "o") == 3
    )
    assert "found no plan within 0.001 s; expected more --time-limit" in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("problem.yaml", "count: 3", "count: 0", "count: found 0"),
        ("problem.yaml", "hertz: 10", "hertz: -10", "frame_rate"),
        ("problem.yaml", "hertz: 10", "hertz: .nan", "frame_rate"),
        (
            "problem.yaml",
            "[{id: uav, site: air, count: 3}]",
            "[{id: uav, site: a}, {id: uav, site: b}]",
            "stream 'uav' again",
        ),
        (
            "problem.yaml",
            "[{mbps: 1}, {mbps: 4}]",
            "[{mbps: 6}]",
            "only bitrates above every link, 6e+06 bps and more",
        ),
        ("pool.yaml", "machine: cpu", "machine: gpu", "a machine type of the pool: gpu"),
        ("pool.yaml", "gigabytes: 1", "gigabytes: -1", "memory"),
        ("inventory.yaml", "mbps: 5", "mbps: 0", "streams.uav: found no link to any site"),
        ("inventory.yaml", "stream: uav", "stream: other", "links.0.stream: found 'other'"),
        ("problem.yaml", "  bitrates", "  expected_size: true\n  bitrates", "view: found none"),
    ],
)
def test_what_cannot_be_used_is_one_line_with_file_and_field(
    problem: Path,
    file: str,
    old: str,
    new: str,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    change(problem, file, old, new)
    assert run(monkeypatch, problem) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert said in error


def test_the_shipped_example_has_a_plan(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    example = Path(__file__).parents[3] / "configs" / "problems" / "example.yaml"
    assert run(monkeypatch, example) == 0
    assert "optimal: objective" in capsys.readouterr().out
