import json
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.experiments.allocations import CASES, allocations_found, write_cases
from pipeline.mission.planning import plan
from pipeline.mission.prepared import prepare

ROOT = Path(__file__).resolve().parents[3]
DEMO, POOLS = ROOT / "configs/missions/demo/mission.yaml", ROOT / "configs/pools"


def test_the_planner_finds_the_papers_three_allocations(tmp_path: Path) -> None:
    cases = write_cases(DEMO, POOLS / "paper.yaml", POOLS / "simulated.yaml", tmp_path)
    found = {}
    for name, mission in cases.items():
        rows = plan(prepare(mission)).assignments
        assert {row.stream for row in rows} == {"drone-1", "drone-2"}
        found[name] = sorted(
            (row.pool_detector, row.site, row.period, row.bitrate_bps)
            for row in rows
            if row.stream == "drone-1"
        )
    assert found == {
        "a": [("nano", "drone-1", 1, 20e6)],
        "d": [("medium", "d1", 1, 20e6)],
        "dd": [("large", "d1", 2, 20e6), ("large", "d2", 2, 20e6)],
    }, (
        "on the CPU of A at 5 Hz; R50 on D at 10 Hz; the large one at both, 5 Hz each, a link of 10 Mbps to each"
    )


def test_a_mission_without_truth_and_a_pool_without_ours_are_refused(tmp_path: Path) -> None:
    blind = tmp_path / "mission.yaml"
    lines = DEMO.read_text(encoding="utf-8").splitlines()
    (tmp_path / "terrain.tif").touch()
    blind.write_text("\n".join(line for line in lines if not line.startswith("truth:")), encoding="utf-8")
    with pytest.raises(InputError, match="no truth"):
        write_cases(blind, POOLS / "paper.yaml", POOLS / "simulated.yaml", tmp_path / "out")
    with pytest.raises(InputError, match="no detector 'nano'"):
        write_cases(DEMO, POOLS / "paper.yaml", POOLS / "demo.yaml", tmp_path / "out")


def test_what_was_found_stands_beside_the_papers(tmp_path: Path) -> None:
    row = {"stream": "v", "detector": "m:nano", "site": "s", "period": 2, "bitrate_bps": 5e6}
    for k, case in enumerate(CASES):
        folder = tmp_path / case.name
        folder.mkdir()
        found = [{"place": number, "person": str(number)} for number in range(k + 1)]
        places = [{"id": number, "probability": 0.5 + 0.1 * number} for number in range(5)]
        truth = {"people": 9, "found": found, "false": [4] * k}
        (folder / "summary.json").write_text(json.dumps({"truth": truth, "found": places}))
        (folder / "plan.json").write_text(json.dumps({"plan": {"assignments": [row]}}))
    experiment = allocations_found({case.name: tmp_path / case.name for case in CASES})
    assert [m.ours for m in experiment.measures] == pytest.approx([1, 0.5, 0, 2, 0.55, 1, 3, 0.6, 2])
    assert [m.paper for m in experiment.measures if m.paper] == [
        "5 of 9",
        "0.59",
        "9 of 9",
        "0.82",
        "9 of 9",
        "0.93",
    ]
    assert "nano at s, every 2. picture, 5 Mbps" in experiment.text
