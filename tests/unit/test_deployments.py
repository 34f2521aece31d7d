"""What stands in deployments/: rules and dashboard ask for metrics that there are."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import pytest
import yaml

from actors.metrics import RunCollector, Snapshot
from actors.node_metrics import NodeCollector
from pipeline.mission.live_files import MapFigures
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
    known = replace(reducer(7), map=MapFigures(1, 2, 3.0), ages_s={"v": 1.0})
    collector = RunCollector(Snapshot(PLAN, {"v": source()}, known, {("v", "ground"): 6e6}))
    names = {family.name for family in (*collector.collect(), *NodeCollector(["ground"]).collect())}
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


# --- machines


DEPLOYMENTS = ROOT / "deployments"


def test_what_was_not_run_says_so_in_its_first_line() -> None:
    for name in ("Dockerfile", "kuberay.yaml"):
        assert (DEPLOYMENTS / name).read_text(encoding="utf-8").startswith("# not run: "), name


def test_the_image_copies_what_is_there_and_installs_the_lock() -> None:
    text = (DEPLOYMENTS / "Dockerfile").read_text(encoding="utf-8")
    copied = [name for line in re.findall(r"^COPY (.+) \S+$", text, re.MULTILINE) for name in line.split()]
    assert {"pipeline", "actors", "requirements.lock"} <= set(copied)
    assert [name for name in copied if not (ROOT / name).exists()] == []
    assert "--require-hashes -r requirements.lock" in text


def test_rays_own_schema_takes_the_cluster_of_ray_up() -> None:
    import jsonschema
    from ray import autoscaler

    schema = json.loads((Path(autoscaler.__file__).parent / "ray-schema.json").read_text(encoding="utf-8"))
    cluster = yaml.safe_load((DEPLOYMENTS / "ray-cluster.yaml").read_text(encoding="utf-8"))
    jsonschema.validate(cluster, schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(cluster | {"workers": 3}, schema)
    for command in (*cluster["head_start_ray_commands"], *cluster["worker_start_ray_commands"]):
        script = command.split()[0].removeprefix("/opt/searchlight/")
        assert script == ".venv/bin/ray" or (ROOT / script).is_file()


def test_kubernetes_nodes_play_the_sites_of_the_demo_and_wait_as_long_as_ray_node_sh() -> None:
    cluster = yaml.safe_load((DEPLOYMENTS / "kuberay.yaml").read_text(encoding="utf-8"))
    spec = cluster["spec"]
    groups = [spec["headGroupSpec"], *spec["workerGroupSpecs"]]
    given = [json.loads(json.loads(group["rayStartParams"]["resources"])) for group in groups]
    inventory = yaml.safe_load((ROOT / "configs/inventories/demo.yaml").read_text(encoding="utf-8"))
    assert {site for node in given for site in node} == {f"site:{site['id']}" for site in inventory["sites"]}
    script = (DEPLOYMENTS / "ray-node.sh").read_text(encoding="utf-8")
    waits = dict(re.findall(r'export (RAY_\w+)="\$\{RAY_\w+:-(\d+)\}"', script))
    assert len(waits) == 4
    for group in groups:
        (container,) = group["template"]["spec"]["containers"]
        said = {one["name"]: one.get("value") for one in container["env"]}
        assert {name: said[name] for name in waits} == waits
    assert spec["rayVersion"].rpartition(".")[0] == version("ray").rpartition(".")[0]


def test_ray_knows_the_waits_that_it_is_given() -> None:
    import ray

    server = (Path(ray.__file__).parent / "core/src/ray/gcs/gcs_server").read_bytes()
    script = (DEPLOYMENTS / "ray-node.sh").read_text(encoding="utf-8")
    names = re.findall(r"export RAY_([a-z_]+)=", script)
    assert len(names) == 4
    assert [name for name in names if name.encode() not in server] == []


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
@pytest.mark.parametrize("unit", sorted(path.name for path in (DEPLOYMENTS / "systemd").iterdir()))
def test_systemd_takes_the_units(unit: str, tmp_path: Path) -> None:
    text = (DEPLOYMENTS / "systemd" / unit).read_text(encoding="utf-8").replace("/opt/searchlight", str(ROOT))
    (tmp_path / unit).write_text(text, encoding="utf-8")

    def verified() -> subprocess.CompletedProcess[str]:
        command = ["systemd-analyze", "verify", str(tmp_path / unit)]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    told = verified()
    assert (told.returncode, told.stderr) == (0, ""), told.stderr
    (tmp_path / unit).write_text(text.replace("RestartSec=", "RestartSecs="), encoding="utf-8")
    assert "RestartSecs" in verified().stderr


@pytest.mark.slow
@pytest.mark.parametrize("processor", ["x86_64", "aarch64"])
def test_there_is_a_wheel_of_every_locked_package_for(processor: str, tmp_path: Path) -> None:
    """pip resolves the lock for a processor, and downloads nothing. embreex is for simulate alone, and not on Arm."""
    entries = re.split(r"\n(?=[A-Za-z0-9])", (ROOT / "requirements.lock").read_text(encoding="utf-8"))
    # pip asks this machine's Python about markers: what the other processor leaves out is left out here
    kept = [e for e in entries if not (processor in e.split("\\")[0] and "!=" in e.split("\\")[0])]
    lock = tmp_path / "requirements.lock"
    lock.write_text(
        "\n".join(e for e in kept if "python_full_version < '3.11.5'" not in e) + "\n", encoding="utf-8"
    )
    glibc = (
        "2_36",
        "2_35",
        "2_34",
        "2_31",
        "2_28",
        "2_27",
        "2_26",
        "2_24",
        "2_17",
        "2_12",
        "2_5",
        "2014",
        "1",
    )
    named = [f"manylinux_{g}_{processor}" if "_" in g else f"manylinux{g}_{processor}" for g in glibc]
    platforms = [word for name in (*named, f"linux_{processor}") for word in ("--platform", name)]
    command = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--no-deps"]
    command += ["--only-binary=:all:", "--disable-pip-version-check", "--python-version", "3.11.7"]
    command += ["--implementation", "cp", "--target", str(tmp_path / "to"), "-r", str(lock), *platforms]
    told = subprocess.run(command, capture_output=True, text=True, check=False, timeout=280)
    if "Temporary failure" in told.stderr or "Connection" in told.stderr:
        pytest.skip("no package index to be reached")
    assert told.returncode == 0, told.stderr[-2000:]
