"""The product as a user runs it: the command line, on a real local Ray."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.parse
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SEARCHLIGHT = [sys.executable, "-m", "actors.cli"]
PROMETHEUS = shutil.which("prometheus") or ROOT / ".venv/tools/usr/bin/prometheus"

pytestmark = [pytest.mark.ray, pytest.mark.timeout(240)]


def searchlight(*arguments: object, env: dict[str, str] | None = None) -> subprocess.CompletedProcess[str]:
    command = [*SEARCHLIGHT, *map(str, arguments)]
    return subprocess.run(
        command, cwd=ROOT, env=env, capture_output=True, text=True, timeout=200, check=False
    )


@pytest.fixture(scope="module")
def ray_run(small_mission: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("ray") / "run"
    result = searchlight("run", small_mission, "--out", out, "--pace", "max")
    assert result.returncode == 0, result.stderr
    return out


def test_ray_and_local_give_the_same_map_byte_for_byte(
    small_mission: Path, ray_run: Path, tmp_path: Path
) -> None:
    result = searchlight("run", small_mission, "--out", tmp_path / "local", "--local")
    assert result.returncode == 0, result.stderr
    for name in ("saliency.tif", "salient.geojson"):
        assert (ray_run / name).read_bytes() == (tmp_path / "local" / name).read_bytes(), name


def test_every_frame_is_accounted_for(ray_run: Path) -> None:
    summary = json.loads((ray_run / "summary.json").read_text())
    assert len(summary["streams"]) == 2
    for stream in summary["streams"]:
        assert stream["captured"] == stream["processed"] + sum(stream["dropped"].values())
        assert stream["processed"] > 0


def test_the_run_directory_holds_everything_and_nothing_half_written(ray_run: Path) -> None:
    names = {path.name for path in ray_run.iterdir()}
    assert {"saliency.tif", "salient.geojson", "plan.json", "summary.json", "report.html"} <= names
    assert not list(ray_run.parent.glob(".*part"))


def test_a_local_run_leaves_no_ray_process_and_no_folder_behind(ray_run: Path) -> None:
    assert not list(Path("/tmp").glob("searchlight-*/session_latest"))


@pytest.fixture
def second_node_cluster(tmp_path: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """A head that plays the drones and a second node that plays the ground, by deployments/ray-node.sh."""
    port = _free_port()
    env = os.environ | {
        "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",
        "RAY_AUTH_MODE": "token",
        "RAY_AUTH_TOKEN": "ab" * 32,
        "RAY_USAGE_STATS_ENABLED": "0",
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
    }
    folder = Path("/tmp") / f"sl-{os.getpid()}"
    folder.mkdir()
    node = [ROOT / "deployments/ray-node.sh", "--node-ip-address=127.0.0.1", "--num-cpus=1", "--block"]
    head = [*node, "--head", f"--port={port}", f"--temp-dir={folder}", "--object-store-memory=100000000"]
    worker = [*node, f"--address=127.0.0.1:{port}", "--object-store-memory=100000000"]
    processes = []
    try:
        with open(tmp_path / "head.log", "wb") as log:
            processes.append(
                subprocess.Popen(
                    head, env=env | {"SEARCHLIGHT_SITES": "drone-1 drone-2"}, stdout=log, stderr=log
                )
            )
        _wait_for_port(port)
        with open(tmp_path / "worker.log", "wb") as log:
            processes.append(
                subprocess.Popen(worker, env=env | {"SEARCHLIGHT_SITES": "ground"}, stdout=log, stderr=log)
            )
        yield f"127.0.0.1:{port}", env
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait(30)
        shutil.rmtree(folder, ignore_errors=True)


def test_a_second_ray_node_takes_a_site_and_prometheus_scrapes_the_run(
    small_mission: Path, second_node_cluster: tuple[str, dict[str, str]], ray_run: Path, tmp_path: Path
) -> None:
    if not Path(PROMETHEUS).is_file():
        pytest.skip("no prometheus on this machine (Debian: apt install prometheus)")
    address, env = second_node_cluster
    _wait_for_site(address, "ground", env)
    web = _free_port()
    prometheus = subprocess.Popen(
        [
            PROMETHEUS,
            f"--config.file={ROOT / 'deployments/prometheus/prometheus.yml'}",
            f"--web.listen-address=127.0.0.1:{web}",
            f"--storage.tsdb.path={tmp_path / 'tsdb'}",
            "--log.level=error",
        ]
    )
    try:
        _wait_for_port(web)
        out = tmp_path / "run"
        arguments = ("--address", address, "--pace", "realtime", "--metrics-port", 9400)
        result = searchlight("run", small_mission, "--out", out, *arguments, env=env)
        assert result.returncode == 0, result.stderr
        captured = _query(web, "max_over_time(searchlight_frames_captured_total[10m])")
        assert {r["metric"]["stream"] for r in captured} == {"drone-1", "drone-2"}
        assert _query(web, "max_over_time(searchlight_plan_objective[10m])")
        processed = _query(web, 'max_over_time(searchlight_frames_total{outcome="processed"}[10m])')
        assert all(float(r["value"][1]) > 0 for r in processed)
        assert _query(web, "max_over_time(searchlight_link_bytes_total[10m])")
        assert _query(web, "max_over_time(searchlight_hop_seconds_count[10m])")
    finally:
        prometheus.terminate()
        prometheus.wait(30)
    summary = json.loads((out / "summary.json").read_text())
    assert {s["site"] for s in summary["substreams"]} >= {"ground"}


def test_a_cluster_without_the_site_is_one_clear_line(
    small_mission: Path, second_node_cluster: tuple[str, dict[str, str]], tmp_path: Path
) -> None:
    address, env = second_node_cluster
    _wait_for_site(address, "ground", env)
    inventory = small_mission.parent / "other-inventory.yaml"
    text = (small_mission.parent / "inventory.yaml").read_text()
    inventory.write_text(text.replace("ground", "base"))
    mission = small_mission.parent / "other.yaml"
    mission.write_text(small_mission.read_text().replace("inventory.yaml", "other-inventory.yaml"))
    result = searchlight("run", mission, "--out", tmp_path / "run", "--address", address, env=env)
    assert result.returncode == 2
    assert "site:base" in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "run").exists()


def _free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def _wait_for_port(port: int, patience_s: float = 60.0) -> None:
    end = time.monotonic() + patience_s
    while time.monotonic() < end:
        with socket.socket() as s:
            if s.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.2)
    raise TimeoutError(f"nobody listens on port {port}")


def _wait_for_site(address: str, site: str, env: dict[str, str], patience_s: float = 60.0) -> None:
    code = (
        "import ray, sys, time\n"
        f"ray.init(address={address!r}, log_to_driver=False, logging_level='error')\n"
        f"end = time.monotonic() + {patience_s}\n"
        f"while 'site:{site}' not in ray.cluster_resources():\n"
        "    time.sleep(0.5); assert time.monotonic() < end\n"
    )
    subprocess.run([sys.executable, "-c", code], env=env, check=True, timeout=patience_s + 60)


def _query(port: int, expression: str) -> list[dict]:  # type: ignore[type-arg]
    url = f"http://127.0.0.1:{port}/api/v1/query?" + urllib.parse.urlencode({"query": expression})
    with urllib.request.urlopen(url, timeout=10) as answer:
        return json.load(answer)["data"]["result"]  # type: ignore[no-any-return]
