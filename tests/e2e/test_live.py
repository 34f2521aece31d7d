"""The demo's two drones, live: sent in real time over UDP with KLV inside, into a run on Ray."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from pipeline.mission.operator import ask
from tests.dialects.demo import DEMO, ROOT, STREAMS, mission_with
from tests.live_sender import Order, start
from tests.unit.ingest.live_streams import free_port

pytestmark = [pytest.mark.slow, pytest.mark.ray, pytest.mark.timeout(400)]


def test_drones_that_fly_now_give_the_map_of_their_recordings(tmp_path: Path) -> None:
    go, out = tmp_path / "go", tmp_path / "run"
    urls = {name: f"udp://127.0.0.1:{free_port()}" for name in STREAMS}
    told = {name: {"file": url, "height_datum": "ellipsoid"} for name, url in urls.items()}
    path = mission_with(tmp_path, told)
    mission = yaml.safe_load(path.read_text(encoding="utf-8"))
    for stream in mission["streams"]:
        stream["video"] = urls[stream["id"]]
    path.write_text(yaml.safe_dump(mission), encoding="utf-8")
    senders = [
        start(
            Order(
                f"{urls[name]}?pkt_size=1316",
                seconds=None,
                rate_hz=30,
                video=str(DEMO / f"{name}.mp4"),
                track=str(DEMO / f"{name}.srt"),
                hold=str(go),
            )
        )
        for name in STREAMS
    ]
    command = [sys.executable, "-m", "actors", "run", str(path), "--out", str(out)]
    run = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        _wait_until_it_films(run, out)
        go.write_text("")
        for sender in senders:
            assert sender.wait(timeout=120) == 0
        time.sleep(3.0)
        ask(out, "stop", None)
        said, _ = run.communicate(timeout=120)
    finally:
        for process in (*senders, run):
            process.kill()
    assert run.returncode == 0, said
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert len(summary["truth"]["found"]) == 9
    assert summary["truth"]["mean_distance_m"] < 0.3
    # of the first picture, which the sender shows for as long as it hovers, a detector may believe something
    assert len(summary["truth"]["false"]) <= 1
    for stream in summary["streams"]:
        assert stream["captured"] == stream["processed"] + sum(stream["dropped"].values())
        assert stream["captured"] > 1402
        assert stream["processed"] > 0.3 * stream["captured"]
    told = [(entry["what"], entry["subject"]) for entry in summary["timeline"]]
    for name in STREAMS:
        assert ("flows", name) in told
        assert ("silent", name) in told, "the sender's end, which UDP has no word for"
    assert summary["partial"] is None


def _wait_until_it_films(run: subprocess.Popen[str], out: Path) -> None:
    until_s = time.monotonic() + 120.0
    while time.monotonic() < until_s and run.poll() is None:
        for log in out.parent.glob(f".{out.name}.*.log.part"):
            lines = log.read_text(encoding="utf-8").splitlines()
            if sum('"event": "flows"' in line for line in lines) == len(STREAMS):
                return
        time.sleep(0.2)
    raise AssertionError(run.communicate(timeout=10)[0])
