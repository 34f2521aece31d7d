"""The product as a user runs it: the command line, on a real local Ray."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import urllib.parse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from tests.unit.mission.test_mission_onto import one_drone

ROOT = Path(__file__).resolve().parents[2]
SEARCHLIGHT = [sys.executable, "-m", "actors.cli"]
PROMETHEUS = shutil.which("prometheus") or ROOT / ".venv/tools/usr/bin/prometheus"

pytestmark = [pytest.mark.ray, pytest.mark.timeout(240)]


def searchlight(
    *arguments: object, env: dict[str, str] | None = None, within: Sequence[str] = ()
) -> subprocess.CompletedProcess[str]:
    command = [*within, *SEARCHLIGHT, *map(str, arguments)]
    return subprocess.run(
        command, cwd=ROOT, env=env, capture_output=True, text=True, timeout=200, check=False
    )


def _ray_folders() -> set[Path]:
    return {path.parent for path in Path("/tmp").glob("searchlight-*/session_latest")}


@pytest.fixture(scope="module")
def folders_before() -> set[Path]:
    return _ray_folders()


@pytest.fixture(scope="module")
def ray_run(folders_before: set[Path], small_mission: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
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


@pytest.mark.slow
def test_detectors_in_processes_of_their_own_give_the_same_map(
    small_mission: Path, ray_run: Path, tmp_path: Path
) -> None:
    shutil.copytree(small_mission.parent, tmp_path / "mission", symlinks=True)
    mission = tmp_path / "mission" / small_mission.name
    document = yaml.safe_load(mission.read_text(encoding="utf-8"))
    document["processing"]["detectors_in"] = "processes"
    mission.write_text(yaml.safe_dump(document), encoding="utf-8")
    result = searchlight("run", mission, "--out", tmp_path / "run", "--pace", "max")
    assert result.returncode == 0, result.stderr
    for name in ("saliency.tif", "salient.geojson"):
        assert (ray_run / name).read_bytes() == (tmp_path / "run" / name).read_bytes(), name
    left = subprocess.run(["pgrep", "-f", "stages.detector_process"], capture_output=True, check=False)
    assert left.stdout == b"", "no process stays"


@pytest.mark.slow
def test_a_second_flight_on_ray_goes_on_with_the_map_as_in_one_process(
    small_mission: Path, tmp_path: Path
) -> None:
    missions = [one_drone(small_mission, tmp_path / str(k), k) for k in range(2)]
    first = searchlight("run", missions[0], "--out", tmp_path / "first", "--local")
    assert first.returncode == 0, first.stderr
    for name, how in (("ray", ("--pace", "max")), ("local", ("--local",))):
        onto = ("--onto", tmp_path / "first", "--out", tmp_path / name)
        result = searchlight("run", missions[1], *onto, *how)
        assert result.returncode == 0, result.stderr
    for name in ("saliency.tif", "salient.geojson"):
        assert (tmp_path / "ray" / name).read_bytes() == (tmp_path / "local" / name).read_bytes(), name
    assert (tmp_path / "ray/saliency.tif").read_bytes() != (tmp_path / "first/saliency.tif").read_bytes()


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


def test_a_local_run_leaves_no_ray_process_and_no_folder_behind(
    folders_before: set[Path], ray_run: Path
) -> None:
    # another test may have killed a run, which leaves its folder
    assert _ray_folders() <= folders_before


LOOPBACK_UP = (
    "import fcntl, socket, struct, time\n"
    "fcntl.ioctl(socket.socket(), 0x8914, struct.pack('16sh', b'lo', 0x41))\n"  # SIOCSIFFLAGS, up and running
    "print('up', flush=True)\n"
    "time.sleep(900)\n"
)


@dataclass(frozen=True)
class Island:
    """within: the prefix of a command that runs there."""

    within: tuple[str, ...]
    address: str
    env: dict[str, str]

    def start(self, log: Path, *command: object, **extra: str) -> subprocess.Popen[bytes]:
        with log.open("wb") as out:
            words = [*self.within, *map(str, command)]
            return subprocess.Popen(words, env=self.env | extra, stdout=out, stderr=out)

    def python(self, code: str) -> str:
        words = [*self.within, sys.executable, "-c", code]
        done = subprocess.run(words, env=self.env, capture_output=True, text=True, timeout=150, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout


@pytest.fixture(scope="module")
def network() -> Iterator[tuple[str, ...]]:
    """A network with nothing but loopback, since a cluster of several nodes listens on every interface."""
    if os.geteuid() != 0 or not (shutil.which("unshare") and shutil.which("nsenter")):
        pytest.skip("only root can make a network namespace, with unshare and nsenter of util-linux")
    holder = subprocess.Popen(
        ["unshare", "--net", sys.executable, "-c", LOOPBACK_UP], stdout=subprocess.PIPE, text=True
    )
    try:
        assert holder.stdout is not None
        if holder.stdout.readline() != "up\n":
            pytest.skip("this machine does not let us make a network namespace")
        yield ("nsenter", f"--target={holder.pid}", "--net")
    finally:
        holder.kill()
        holder.wait()


@pytest.fixture(scope="module")
def island(network: tuple[str, ...], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Island]:
    """A head that plays the drones and a second node that plays the ground, by deployments/ray-node.sh."""
    env = os.environ | {
        "RAY_AUTH_MODE": "token",
        "RAY_AUTH_TOKEN": "ab" * 32,
        "RAY_USAGE_STATS_ENABLED": "0",
        "SEARCHLIGHT_TLS": "off",
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
    }
    place = Island(network, "127.0.0.2:6379", env)
    logs, folder = tmp_path_factory.mktemp("nodes"), Path("/tmp") / f"sl-{os.getpid()}"
    folder.mkdir()
    # Ray replaces 127.0.0.1 by the machine's outside address, but leaves the rest of the loopback range alone
    node = (ROOT / "deployments/ray-node.sh", "--num-cpus=1", "--block", "--object-store-memory=100000000")
    head = (*node, "--head", "--node-ip-address=127.0.0.2", "--port=6379", f"--temp-dir={folder}")
    worker = (*node, "--node-ip-address=127.0.0.3", f"--address={place.address}")
    processes = []
    try:
        processes.append(place.start(logs / "head.log", *head, SEARCHLIGHT_SITES="drone-1 drone-2"))
        place.python(WAIT_FOR_PORT.format(host="127.0.0.2", port=6379))
        processes.append(place.start(logs / "worker.log", *worker, SEARCHLIGHT_SITES="ground"))
        place.python(WAIT_FOR_SITE.format(address=place.address, site="ground"))
        yield place
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait(60)
        shutil.rmtree(folder, ignore_errors=True)


@pytest.mark.slow
def test_a_second_ray_node_takes_a_site_and_prometheus_scrapes_the_run(
    small_mission: Path, island: Island, tmp_path: Path
) -> None:
    if not Path(PROMETHEUS).is_file():
        pytest.skip("no prometheus on this machine (Debian: apt install prometheus)")
    prometheus = island.start(
        tmp_path / "prometheus.log",
        PROMETHEUS,
        f"--config.file={ROOT / 'deployments/prometheus/prometheus.yml'}",
        "--web.listen-address=127.0.0.1:9090",
        f"--storage.tsdb.path={tmp_path / 'tsdb'}",
    )
    try:
        island.python(WAIT_FOR_PORT.format(host="127.0.0.1", port=9090))
        out = tmp_path / "run"
        arguments = ("--address", island.address, "--pace", "realtime", "--metrics-port", 9400)
        result = searchlight(
            "run", small_mission, "--out", out, *arguments, env=island.env, within=island.within
        )
        assert result.returncode == 0, result.stderr
        captured = _query(island, "max_over_time(searchlight_frames_captured_total[10m])")
        assert {r["metric"]["stream"] for r in captured} == {"drone-1", "drone-2"}
        assert _query(island, "max_over_time(searchlight_plan_objective[10m])")
        processed = _query(island, 'max_over_time(searchlight_frames_total{outcome="processed"}[10m])')
        assert all(float(r["value"][1]) > 0 for r in processed)
        assert _query(island, "max_over_time(searchlight_link_bytes_total[10m])")
        assert _query(island, "max_over_time(searchlight_hop_seconds_count[10m])")
        summary = json.loads((out / "summary.json").read_text())
        for stream in summary["streams"]:
            last = f'max_over_time(searchlight_frames_captured_total{{stream="{stream["stream"]}"}}[10m])'
            assert float(_query(island, last)[0]["value"][1]) == stream["captured"], (
                "the last values are scraped"
            )
            looked = last.replace("captured_total{", 'total{outcome="processed",')
            assert float(_query(island, looked)[0]["value"][1]) == stream["processed"]
        for name in ("searchlight_frames_total", "searchlight_link_bytes_total", "searchlight_results_total"):
            assert all(float(r["value"][1]) == 0 for r in _query(island, f"resets({name}[10m])")), (
                "a count fell"
            )
        for expression in _of_the_dashboard():
            assert _query(island, f"last_over_time(({expression})[10m:1s])"), expression
    finally:
        prometheus.terminate()
        prometheus.wait(30)
    summary = json.loads((out / "summary.json").read_text())
    assert "ground" in {s["site"] for s in summary["substreams"]}


def test_a_cluster_without_the_site_is_one_clear_line(
    small_mission: Path, island: Island, tmp_path: Path
) -> None:
    inventory = small_mission.parent / "other-inventory.yaml"
    text = (small_mission.parent / "inventory.yaml").read_text()
    inventory.write_text(text.replace("ground", "base"))
    mission = small_mission.parent / "other.yaml"
    mission.write_text(small_mission.read_text().replace("inventory.yaml", "other-inventory.yaml"))
    arguments = ("--out", tmp_path / "run", "--address", island.address)
    result = searchlight("run", mission, *arguments, env=island.env, within=island.within)
    assert result.returncode == 2
    assert "site:base" in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "run").exists()


WAIT_FOR_PORT = """
import socket, time
end = time.monotonic() + 60
while socket.socket().connect_ex(("{host}", {port})) != 0:
    assert time.monotonic() < end, "nobody listens"
    time.sleep(0.2)
"""

WAIT_FOR_SITE = """
import ray, time
ray.init(address="{address}", log_to_driver=False, logging_level="error")
end = time.monotonic() + 120
while "site:{site}" not in ray.cluster_resources():
    assert time.monotonic() < end, "the site does not come"
    time.sleep(0.5)
"""


def _of_the_dashboard() -> list[str]:
    """Its queries, but those that are empty in a run that is well."""
    dashboard = json.loads((ROOT / "deployments/prometheus/grafana-dashboard.json").read_text())
    asked = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
    return [e for e in asked if not any(name in e for name in ("verdict_doubts", "not_taken", "outcome!~"))]


def _query(island: Island, expression: str) -> list[dict]:  # type: ignore[type-arg]
    url = "http://127.0.0.1:9090/api/v1/query?" + urllib.parse.urlencode({"query": expression})
    code = f"import urllib.request; print(urllib.request.urlopen({url!r}, timeout=10).read().decode())"
    return json.loads(island.python(code))["data"]["result"]  # type: ignore[no-any-return]
