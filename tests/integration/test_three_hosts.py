"""Over three hosts a run gives the map of one process, and a link that is cut costs frames and nothing else."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.link.handshake import HELLO
from pipeline.mission.prepared import prepare
from pipeline.outputs.place_picture import FOLDER as PICTURES
from tests.chaos_on_ray import JournalWatch, judge
from tests.three_hosts import HOSTS, PORT, ROOT, Hosts, refused, three_hosts

DEMO = ROOT / "configs/missions/demo/mission.yaml"
SITES = ("drone-1", "drone-2")
#: nothing of the journal is taken into a checkpoint and removed
WHOLE_JOURNAL = ("--checkpoint-every", "100000")

pytestmark = [pytest.mark.ray, pytest.mark.timeout(400)]
if (reason := refused()) is not None:
    pytestmark.append(pytest.mark.skip(reason))


@pytest.fixture(scope="module")
def hosts() -> Iterator[Hosts]:
    with three_hosts() as joined:
        yield joined


def _ended(process: subprocess.Popen[str]) -> str:
    said, _ = process.communicate(timeout=240)
    assert process.returncode == 0, said
    return said


def _flying(hosts: Hosts, mission: Path, out: Path, *more: str) -> subprocess.Popen[str]:
    """A run in real time whose actors have started."""
    process = hosts.searchlight("run", str(mission), "--out", str(out), "--pace", "realtime", *more)
    until = time.monotonic() + 120.0
    while not any("actors started" in p.read_text() for p in out.parent.glob(f".{out.name}.*.log.part")):
        assert time.monotonic() < until, process.communicate(timeout=10)
        assert process.poll() is None, process.communicate()
        time.sleep(0.2)
    return process


def _accounted_for(process: subprocess.Popen[str], out: Path) -> dict[str, Any]:
    """The summary of a run that has ended well."""
    _ended(process)
    summary = dict(json.loads((out / "summary.json").read_text(encoding="utf-8")))
    assert summary["partial"] is None
    for stream in summary["streams"]:
        assert stream["captured"] == stream["processed"] + sum(stream["dropped"].values())
        assert stream["processed"] > 0
    return summary


def _cut_off(hosts: Hosts, mission: Path, out: Path, *, after_s: float, for_s: float) -> dict[str, Any]:
    """The summary of a run in real time whose drone-1 was off the network for a while."""
    process = _flying(hosts, mission, out)
    time.sleep(after_s)
    hosts.cut("d1")
    time.sleep(for_s)
    hosts.cut("d1", up=True)
    return _accounted_for(process, out)


def _files_that_hold(secret: bytes, folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file() and secret in path.read_bytes()]


def test_over_three_hosts_it_is_the_map_of_one_process_and_whoever_listens_learns_nothing(
    hosts: Hosts, small_mission: Path, tmp_path: Path
) -> None:
    """Ray and the channels are encrypted: no secret, no name of a stream, nothing that Ray says is heard in clear."""
    with hosts.overheard(tmp_path / "wire"):
        process = hosts.searchlight("run", str(small_mission), "--out", str(tmp_path / "three"))
        time.sleep(5.0)
        seen = hosts.command_lines()
        said = _ended(process)
    heard = (tmp_path / "wire").read_bytes()
    assert len(heard) > 1_000_000, "the video went over the bridge"
    assert heard.count(HELLO) >= 2, "channels were heard to begin"
    secret = hosts.environment["RAY_AUTH_TOKEN"].encode()
    for marker in (secret, b"drone-1", b"person", b"site:", b"SourceActor", b"searchlight", b"PRIVATE KEY"):
        assert marker not in heard, marker
    assert b"actors run" in seen
    assert secret not in seen
    assert secret.decode() not in said
    assert _files_that_hold(secret, tmp_path / "three") == []
    local = [
        sys.executable,
        "-m",
        "actors",
        "run",
        str(small_mission),
        "--out",
        str(tmp_path / "one"),
        "--local",
    ]
    subprocess.run(local, cwd=ROOT, check=True, capture_output=True)
    one, three = (tmp_path / name / "saliency.tif" for name in ("one", "three"))
    assert three.read_bytes() == one.read_bytes()


def test_a_link_that_is_cut_for_5_s_costs_frames_and_every_one_is_accounted_for(
    hosts: Hosts, small_mission: Path, tmp_path: Path
) -> None:
    summary = _cut_off(hosts, small_mission, tmp_path / "run", after_s=2.0, for_s=5.0)
    said = [(entry["what"], entry["subject"]) for entry in summary["timeline"]]
    assert ("cut off", "site:drone-1") in said
    assert ("started again", "source:drone-1") not in said, "what runs on the drone goes on by itself"


@pytest.mark.slow
@pytest.mark.parametrize("rate", ["3mbit", "1mbit", "500kbit"])
def test_a_link_that_becomes_weak_is_planned_around_and_everybody_is_found(
    hosts: Hosts, tmp_path: Path, rate: str
) -> None:
    process = _flying(hosts, DEMO, tmp_path / "run")
    time.sleep(10.0)
    try:
        hosts.weaken("d1", rate)
        summary = _accounted_for(process, tmp_path / "run")
    finally:
        hosts.strengthen("d1")
    assert (len(summary["truth"]["found"]), summary["truth"]["false"]) == (9, [])
    own = next(s for s in summary["substreams"] if s["detector"].startswith("drone-1-computer"))
    assert own["processed"] == own["offered"] > 300


@pytest.mark.slow
def test_a_drone_that_is_cut_off_for_20_s_comes_back_and_nobody_is_made_up(
    hosts: Hosts, tmp_path: Path
) -> None:
    summary = _cut_off(hosts, DEMO, tmp_path / "run", after_s=10.0, for_s=20.0)
    assert summary["truth"]["false"] == []
    said = [(entry["what"], entry["subject"]) for entry in summary["timeline"]]
    assert said.count(("up", "source:drone-1")) == 2
    assert "started again" not in {what for what, _ in said}, "what runs on the drone goes on by itself"


@pytest.mark.slow
def test_each_file_is_needed_only_where_it_is_read(small_mission: Path, tmp_path: Path) -> None:
    """A drone's video, telemetry and camera lie on the drone only, models at the ground station only."""
    whole, seen = small_mission.parent, tmp_path / "mission"
    on_drone, no_models = tmp_path / "on-drone-1", tmp_path / "no-models"
    shutil.copytree(whole, seen)
    for folder in (on_drone, no_models, seen / "of-drone-1", seen / "models"):
        folder.mkdir()
    mission = yaml.safe_load((seen / "mission.yaml").read_text(encoding="utf-8"))
    for key, file in (("video", "drone-1.mp4"), ("camera", "camera.yaml")):
        mission["streams"][0][key] = f"of-drone-1/{file}"
        shutil.copy(seen / file, on_drone)
    shutil.copy(seen / "drone-1.srt", on_drone)
    (seen / "drone-1.mp4").unlink()
    (seen / "drone-1.srt").unlink()
    mission["streams"][0]["telemetry"]["file"] = "of-drone-1/drone-1.srt"
    (seen / "mission.yaml").write_text(yaml.safe_dump(mission), encoding="utf-8")
    pool = yaml.safe_load((seen / "pool.yaml").read_text(encoding="utf-8"))
    for detector in pool["detectors"]:
        shutil.copy(detector["model"], seen / "models")
        detector["model"] = f"models/{Path(detector['model']).name}"
    (seen / "pool.yaml").write_text(yaml.safe_dump(pool), encoding="utf-8")
    shown = {
        "d1": {seen / "of-drone-1": on_drone, seen / "models": no_models},
        "d2": {seen / "models": no_models},
    }
    kept = {host: {"SEARCHLIGHT_MODELS": str(tmp_path / f"models-of-{host}")} for host in shown}
    with three_hosts("slf", shown, kept) as hosts:
        said = _ended(hosts.searchlight("check", str(seen / "mission.yaml")))
        assert "usable; 2 streams" in said
        mission["streams"][0]["video"] = "of-drone-1/other.mp4"
        (seen / "wrong.yaml").write_text(yaml.safe_dump(mission), encoding="utf-8")
        wrong = hosts.searchlight("check", str(seen / "wrong.yaml"))
        told, _ = wrong.communicate(timeout=120)
        assert wrong.returncode == 2
        assert f"site drone-1: {seen / 'of-drone-1/other.mp4'}: found no file" in told
        _ended(hosts.searchlight("run", str(seen / "mission.yaml"), "--out", str(tmp_path / "three")))
    command = [sys.executable, "-m", "actors", "run", str(small_mission), "--local", "--out"]
    subprocess.run([*command, str(tmp_path / "one")], cwd=ROOT, check=True, capture_output=True)
    one, three = (tmp_path / name / "saliency.tif" for name in ("one", "three"))
    assert three.read_bytes() == one.read_bytes()
    summary = json.loads((tmp_path / "three/summary.json").read_text(encoding="utf-8"))
    used = {a["machine"] for a in summary["substreams"]}
    sent = [file for host in kept for file in (tmp_path / f"models-of-{host}").glob("*.onnx")]
    assert bool(sent) == any(machine != "ground-pc" for machine in used)
    pictures = [sorted(p.name for p in (tmp_path / name / PICTURES).iterdir()) for name in ("one", "three")]
    assert pictures[0] == pictures[1]


@pytest.mark.slow
def test_a_drone_cut_off_for_a_minute_comes_back_and_the_map_is_that_of_what_came(
    hosts: Hosts, tmp_path: Path
) -> None:
    """The demo's flight of 47 s ends while its first drone is away."""
    out = tmp_path / "run"
    watch = JournalWatch(out, tmp_path)
    process = _flying(hosts, DEMO, out, *WHOLE_JOURNAL)
    time.sleep(5.0)
    hosts.cut("d1")
    time.sleep(60.0)
    hosts.cut("d1", up=True)
    summary = _judged(process, out, watch, tmp_path, DEMO)
    assert summary["truth"]["false"] == []


@pytest.mark.slow
def test_a_node_that_is_killed_costs_what_it_filmed_and_the_map_is_that_of_what_came(
    tmp_path: Path,
) -> None:
    with three_hosts("slk") as hosts:
        out = tmp_path / "run"
        watch = JournalWatch(out, tmp_path)
        process = _flying(hosts, DEMO, out, *WHOLE_JOURNAL)
        time.sleep(12.0)
        hosts.kill_all("d1")
        summary = _judged(process, out, watch, tmp_path, DEMO)
        assert summary["truth"]["false"] == []
        lost, whole = (next(s for s in summary["streams"] if s["stream"] == name) for name in SITES)
        assert lost["processed"] < lost["captured"]
        assert whole["processed"] > 0.9 * whole["captured"]


@pytest.mark.slow
def test_a_node_that_joins_again_in_flight_is_used_again(tmp_path: Path) -> None:
    """A drone's node dies and is started anew, as systemd would: its site films and looks again."""
    with three_hosts("slj") as hosts:
        out = tmp_path / "run"
        watch = JournalWatch(out, tmp_path)
        process = _flying(hosts, DEMO, out, *WHOLE_JOURNAL)
        time.sleep(8.0)
        hosts.kill_all("d1")
        time.sleep(3.0)
        hosts.start_node("d1")
        summary = _judged(process, out, watch, tmp_path, DEMO)
        assert summary["truth"]["false"] == []
        said = [(entry["what"], entry["subject"]) for entry in summary["timeline"]]
        assert said.count(("up", "source:drone-1")) == 2, "it films again"


def _judged(
    process: subprocess.Popen[str], out: Path, watch: JournalWatch, kept: Path, mission: Path
) -> dict[str, Any]:
    """The summary of a run that ended well and whose map is, to the byte, that of its journal."""
    summary = _accounted_for(process, out)
    watch.end()
    judge(prepare(mission), out, summary, kept)
    return summary


_ASK = """
import json, ray
ray.init(address="{address}", log_to_driver=False, logging_level="ERROR")
nodes = [(n["NodeID"], n["Alive"], n["NodeManagerAddress"]) for n in ray.nodes()]
where = ray.remote(lambda: ray.util.get_node_ip_address()).options(num_cpus=0, resources={{"site:drone-1": 0.001}})
print(json.dumps([nodes, ray.get(where.remote(), timeout=30)]))
"""


def _demo_with(folder: Path, **processing: object) -> Path:
    """The demo's mission with other keys of ``processing``."""
    folder.mkdir()
    document = yaml.safe_load(DEMO.read_text(encoding="utf-8"))
    document["processing"] |= processing
    for key in ("inventory", "pool"):
        document[key] = str((DEMO.parent / document[key]).resolve())
    for path in DEMO.parent.iterdir():
        if path != DEMO:
            (folder / path.name).symlink_to(path)
    (folder / "mission.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    return folder / "mission.yaml"


@pytest.mark.slow
@pytest.mark.parametrize("cut_s", [20.0, 60.0])
def test_what_a_drone_films_while_it_is_cut_off_is_looked_at_when_its_radio_is_back(
    hosts: Hosts, tmp_path: Path, cut_s: float
) -> None:
    mission = _demo_with(tmp_path / "mission", keep_unsent={"megabytes": 500})
    summary = _cut_off(hosts, mission, tmp_path / "run", after_s=10.0, for_s=cut_s)
    (cut, _) = summary["streams"]
    assert cut["processed"] > 440
    assert (len(summary["truth"]["found"]), summary["truth"]["false"]) == (9, [])


@pytest.mark.slow
@pytest.mark.parametrize("cut_s", [60.0, 100.0])
def test_a_node_whose_radio_was_away_is_there_again_by_itself(cut_s: float) -> None:
    with three_hosts("slc") as hosts:
        before, _ = _asked(hosts)
        hosts.cut("d1")
        time.sleep(cut_s)
        hosts.cut("d1", up=True)
        time.sleep(15.0)
        after, address = _asked(hosts)
    assert sorted(before) == sorted(after), "the same nodes, all alive"
    assert address == HOSTS["d1"][0]


def _asked(hosts: Hosts) -> Any:
    """Ray's nodes, and where work of the first drone's site runs."""
    script = _ASK.format(address=f"{HOSTS['g'][0]}:{PORT}")
    told = subprocess.run(
        hosts.on("g", sys.executable, "-c", script),
        env=hosts.environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert told.returncode == 0, told.stderr
    return json.loads(told.stdout.splitlines()[-1])
