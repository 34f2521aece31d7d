"""Three hosts of a test's own: files that only some of them have, nodes that are lost and come back."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.outputs.place_picture import FOLDER as PICTURES
from tests.chaos_on_ray import JournalWatch
from tests.three_hosts import HOSTS, PORT, ROOT, Hosts, refused, three_hosts
from tests.three_hosts_runs import DEMO, WHOLE_JOURNAL, ended, flying, judged

pytestmark = [pytest.mark.ray, pytest.mark.timeout(400)]
if (reason := refused()) is not None:
    pytestmark.append(pytest.mark.skip(reason))


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
        said = ended(hosts.searchlight("check", str(seen / "mission.yaml")))
        assert "usable; 2 streams" in said
        mission["streams"][0]["video"] = "of-drone-1/other.mp4"
        (seen / "wrong.yaml").write_text(yaml.safe_dump(mission), encoding="utf-8")
        wrong = hosts.searchlight("check", str(seen / "wrong.yaml"))
        told, _ = wrong.communicate(timeout=120)
        assert wrong.returncode == 2
        assert f"site drone-1: {seen / 'of-drone-1/other.mp4'}: found no file" in told
        ended(hosts.searchlight("run", str(seen / "mission.yaml"), "--out", str(tmp_path / "three")))
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
def test_a_node_that_joins_again_in_flight_is_used_again(tmp_path: Path) -> None:
    """A drone's node dies and is started anew, as systemd would: its site films and looks again."""
    with three_hosts("slj") as hosts:
        out = tmp_path / "run"
        watch = JournalWatch(out, tmp_path)
        process = flying(hosts, DEMO, out, *WHOLE_JOURNAL)
        time.sleep(8.0)
        hosts.kill_all("d1")
        time.sleep(3.0)
        hosts.start_node("d1")
        summary = judged(process, out, watch, tmp_path, DEMO)
        assert summary["truth"]["false"] == []
        said = [(entry["what"], entry["subject"]) for entry in summary["timeline"]]
        assert said.count(("up", "source:drone-1")) == 2, "it films again"


_ASK = """
import json, ray
ray.init(address="{address}", log_to_driver=False, logging_level="ERROR")
nodes = [(n["NodeID"], n["Alive"], n["NodeManagerAddress"]) for n in ray.nodes()]
where = ray.remote(lambda: ray.util.get_node_ip_address()).options(num_cpus=0, resources={{"site:drone-1": 0.001}})
print(json.dumps([nodes, ray.get(where.remote(), timeout=30)]))
"""


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
