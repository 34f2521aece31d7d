"""What stands in deployments/: rules and dashboard ask for metrics that there are."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from actors.metrics import RunCollector, Snapshot
from tests.unit.actors.test_actors_metrics import PLAN, reducer, source

ROOT = Path(__file__).resolve().parents[2]
PROMETHEUS = ROOT / "deployments/prometheus"
PROMTOOL = shutil.which("promtool") or str(ROOT / ".venv/tools/usr/bin/promtool")


def _expressions() -> list[str]:
    rules = yaml.safe_load((PROMETHEUS / "rules.yml").read_text())
    asked = [rule["expr"] for group in rules["groups"] for rule in group["rules"]]
    dashboard = json.loads((PROMETHEUS / "grafana-dashboard.json").read_text())
    return asked + [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]


def _served() -> set[str]:
    collector = RunCollector(Snapshot(PLAN, {"v": source()}, reducer(7), {("v", "ground"): 6e6}))
    names = {family.name for family in collector.collect()}
    return names | {f"{name}_{end}" for name in names for end in ("total", "bucket", "sum", "count", "info")}


def test_every_metric_that_rules_and_dashboard_ask_for_is_served() -> None:
    recorded = set(re.findall(r"searchlight:[\w:]+", (PROMETHEUS / "rules.yml").read_text()))
    for expression in _expressions():
        asked = set(re.findall(r"searchlight[\w:]+", expression))
        assert asked <= _served() | recorded | {"searchlight"}, expression


def test_every_alert_is_fired_by_a_test() -> None:
    rules = yaml.safe_load((PROMETHEUS / "rules.yml").read_text())
    alerts = {rule["alert"] for group in rules["groups"] for rule in group["rules"] if "alert" in rule}
    assert alerts
    fired = (PROMETHEUS / "rules.test.yml").read_text()
    assert alerts == set(re.findall(r'alertname="(\w+)"', fired))


@pytest.mark.skipif(not Path(PROMTOOL).exists(), reason="no promtool (.ci/run unpacks Debian's prometheus)")
def test_the_rules_fire_at_their_faults_and_at_nothing_else() -> None:
    told = subprocess.run(
        [PROMTOOL, "test", "rules", PROMETHEUS / "rules.test.yml"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert told.returncode == 0, told.stdout + told.stderr
