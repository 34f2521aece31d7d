"""Over three hosts a run gives the map of one process, and a link that is cut costs frames and nothing else."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.link.handshake import HELLO
from tests.chaos_on_ray import JournalWatch
from tests.three_hosts import ROOT, Hosts, refused, three_hosts
from tests.three_hosts_runs import DEMO, WHOLE_JOURNAL, accounted_for, ended, flying, judged

pytestmark = [pytest.mark.ray, pytest.mark.timeout(400)]
if (reason := refused()) is not None:
    pytestmark.append(pytest.mark.skip(reason))


@pytest.fixture(scope="module")
def hosts() -> Iterator[Hosts]:
    with three_hosts() as joined:
        yield joined


def _cut_off(hosts: Hosts, mission: Path, out: Path, *, after_s: float, for_s: float) -> dict[str, Any]:
    """The summary of a run in real time whose drone-1 was off the network for a while."""
    process = flying(hosts, mission, out)
    time.sleep(after_s)
    hosts.cut("d1")
    time.sleep(for_s)
    hosts.cut("d1", up=True)
    return accounted_for(process, out)


def _files_that_hold(secret: bytes, folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file() and secret in path.read_bytes()]


@pytest.mark.slow
def test_over_three_hosts_it_is_the_map_of_one_process_and_whoever_listens_learns_nothing(
    hosts: Hosts, small_mission: Path, tmp_path: Path
) -> None:
    """Ray and the channels are encrypted: no secret, no name of a stream, nothing that Ray says is heard in clear."""
    with hosts.overheard(tmp_path / "wire"):
        process = hosts.searchlight("run", str(small_mission), "--out", str(tmp_path / "three"))
        time.sleep(5.0)
        seen = hosts.command_lines()
        said = ended(process)
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
    process = flying(hosts, DEMO, tmp_path / "run")
    time.sleep(10.0)
    try:
        hosts.weaken("d1", rate)
        summary = accounted_for(process, tmp_path / "run")
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
def test_a_drone_cut_off_for_a_minute_comes_back_and_the_map_is_that_of_what_came(
    hosts: Hosts, tmp_path: Path
) -> None:
    """The demo's flight of 47 s ends while its first drone is away."""
    out = tmp_path / "run"
    watch = JournalWatch(out, tmp_path)
    process = flying(hosts, DEMO, out, *WHOLE_JOURNAL)
    time.sleep(5.0)
    hosts.cut("d1")
    time.sleep(60.0)
    hosts.cut("d1", up=True)
    summary = judged(process, out, watch, tmp_path, DEMO)
    assert summary["truth"]["false"] == []


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
