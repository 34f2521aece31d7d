"""The demo's two drones, live: sent in real time over UDP with KLV inside, into a run on Ray."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import zlib
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.mission.operator import ask
from pipeline.outputs.place_picture import FOLDER as PICTURES
from pipeline.view.files import POSES
from pipeline.view.poses import decoded
from tests.dialects.demo import DEMO, ROOT, STREAMS, mission_with
from tests.live_sender import Order, rtsp_server, start
from tests.unit.ingest.live_streams import free_port

pytestmark = [pytest.mark.slow, pytest.mark.ray, pytest.mark.timeout(400)]


def test_drones_that_fly_now_give_the_map_of_their_recordings(tmp_path: Path) -> None:
    go, out = tmp_path / "go", tmp_path / "run"
    urls = {name: f"udp://127.0.0.1:{free_port()}" for name in STREAMS}
    told = {name: {"file": url, "height_datum": "ellipsoid"} for name, url in urls.items()}
    path = mission_with(tmp_path, told)
    mission = yaml.safe_load(path.read_text(encoding="utf-8"))
    for stream in mission["streams"]:
        stream |= {"video": urls[stream["id"]], "live": {"record": f"recordings/{stream['id']}"}}
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
    assert len(list((out / PICTURES).iterdir())) >= 9, "of each place, from what was recorded"
    for stream in summary["streams"]:
        assert stream["captured"] == stream["processed"] + sum(stream["dropped"].values())
        assert stream["captured"] > 1402
        assert stream["processed"] > 0.3 * stream["captured"]
    told = [(entry["what"], entry["subject"]) for entry in summary["timeline"]]
    for name in STREAMS:
        assert ("flows", name) in told
        assert ("silent", name) in told, "the sender's end, which UDP has no word for"
    assert summary["partial"] is None


def test_a_password_is_in_no_file_of_a_run_in_no_log_and_in_no_list_of_processes(tmp_path: Path) -> None:
    with rtsp_server(DEMO / "drone-1.mp4", DEMO / "drone-1.srt", "pilot", "Ge7heim5wort") as place:
        url = f"rtsp://pilot:Ge7heim5wort@{place}/live"
        path = one_drone(tmp_path, url)
        out = tmp_path / "run"
        command = [sys.executable, "-m", "actors", "run", str(path), "--out", str(out)]
        run = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        try:
            _wait_until_it_films(run, out, 1)
            time.sleep(4.0)
            seen = [*_files_with(b"Ge7heim5wort", tmp_path), *_processes_with(b"Ge7heim5wort")]
            ask(out, "stop", None)
            said, _ = run.communicate(timeout=120)
        finally:
            run.kill()
    assert run.returncode == 0, said
    assert [*seen, *_files_with(b"Ge7heim5wort", tmp_path)] == [path, path]
    assert "Ge7heim5wort" not in said
    assert _files_with(b"rtsp://pilot:***@", tmp_path), "its address is there, without it"


def test_a_source_that_is_killed_is_started_again_and_films_on(tmp_path: Path) -> None:
    url, out = f"udp://127.0.0.1:{free_port()}", tmp_path / "run"
    path = one_drone(tmp_path, url)
    order = Order(
        f"{url}?pkt_size=1316",
        seconds=None,
        rate_hz=30,
        video=str(DEMO / "drone-1.mp4"),
        track=str(DEMO / "drone-1.srt"),
        hold=str(tmp_path / "never"),
    )
    sender = start(order)
    command = [sys.executable, "-m", "actors", "run", str(path), "--out", str(out)]
    run = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        _wait_until_it_films(run, out, 1)
        time.sleep(3.0)
        up = [e for e in _events(out) if e["event"] == "up" and e["subject"] == "source:drone-1"]
        os.kill(int(str(up[-1]["detail"]).split()[1]), signal.SIGKILL)
        until_s = time.monotonic() + 60.0
        while sum(e["event"] in ("flows", "flows again") for e in _events(out)) < 2:
            assert time.monotonic() < until_s, run.communicate(timeout=10)[0]
            time.sleep(0.2)
        time.sleep(3.0)
        ask(out, "stop", None)
        said, _ = run.communicate(timeout=120)
    finally:
        for process in (sender, run):
            process.kill()
    assert run.returncode == 0, said
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    (stream,) = summary["streams"]
    assert stream["captured"] == stream["processed"] + sum(stream["dropped"].values())
    assert stream["processed"] > 40, "of both processes"
    assert not [f for f in summary["findings"] if f["cause"] == "ledger_contradiction"]
    poses = decoded((out / POSES).read_bytes())[0]
    assert float(np.diff(poses.times_s).max()) > 0.5, "nobody saw it meanwhile"
    assert len(poses.times_s) > 20


def one_drone(folder: Path, url: str) -> Path:
    """The demo's mission with its first drone alone, live."""
    path = mission_with(folder, {"drone-1": {"file": url, "height_datum": "ellipsoid"}, "drone-2": None})
    mission = yaml.safe_load(path.read_text(encoding="utf-8"))
    mission["streams"] = [mission["streams"][0] | {"video": url}]
    inventory = yaml.safe_load(Path(mission["inventory"]).read_text(encoding="utf-8"))
    inventory["links"] = inventory["links"][:1]
    (folder / "inventory.yaml").write_text(yaml.safe_dump(inventory), encoding="utf-8")
    path.write_text(yaml.safe_dump(mission | {"inventory": "inventory.yaml"}), encoding="utf-8")
    return path


def _events(out: Path) -> list[dict[str, object]]:
    """What a run's log says so far."""
    lines = [
        line for log in out.parent.glob(f".{out.name}.*.log.part") for line in log.read_text().splitlines()
    ]
    return [json.loads(line) for line in lines if line.endswith("}")]


def _files_with(word: bytes, folder: Path) -> list[Path]:
    return [p for p in sorted(folder.rglob("*")) if p.is_file() and word in _content(p)]


def _content(path: Path) -> bytes:
    data = path.read_bytes()
    # of a log that is still written, as far as it is
    return zlib.decompressobj(zlib.MAX_WBITS | 16).decompress(data) if path.suffix == ".gz" else data


def _processes_with(word: bytes) -> list[Path]:
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            found += [path] if word in path.read_bytes() else []
    return found


def _wait_until_it_films(run: subprocess.Popen[str], out: Path, streams: int = 2) -> None:
    until_s = time.monotonic() + 120.0
    while time.monotonic() < until_s and run.poll() is None:
        if sum(event["event"] == "flows" for event in _events(out)) == streams:
            return
        time.sleep(0.2)
    raise AssertionError(run.communicate(timeout=10)[0])
