import os
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from actors.node_metrics import NodeCollector
from actors.usage import Usage, resident_bytes

ROOT = Path(__file__).resolve().parents[3]


def made_up_proc(folder: Path, lines: dict[str, str]) -> Path:
    """A folder like /proc with processes by number: their command lines."""
    folder.mkdir()
    (folder / "meminfo").write_text("MemTotal:  2000 kB\nMemFree: 10 kB\nMemAvailable:    500 kB\n")
    (folder / "stat").write_text("cpu  100 0 50 800 40 0 0 0 0 0\ncpu0 1 2 3 4 5\n")
    for number, line in lines.items():
        (folder / number).mkdir()
        (folder / number / "cmdline").write_bytes(line.encode() + b"\0")
    return folder


def samples(collector: NodeCollector) -> dict[tuple[str, ...], float]:
    return {
        (s.name, *s.labels.values()): s.value
        for family in collector.collect()
        for s in family.samples
        if not s.name.endswith("info")
    }


def test_memory_and_processor_of_the_node_are_those_of_the_system(tmp_path: Path) -> None:
    found = samples(NodeCollector(["drone-1"], made_up_proc(tmp_path / "proc", {})))
    tick_s = 1.0 / os.sysconf("SC_CLK_TCK")
    assert found["searchlight_node_memory_total_bytes",] == 2000 * 1024
    assert found["searchlight_node_memory_available_bytes",] == 500 * 1024
    assert found["searchlight_node_cpu_seconds_total", "busy"] == pytest.approx(150 * tick_s)
    assert found["searchlight_node_cpu_seconds_total", "idle"] == pytest.approx(840 * tick_s)


def test_actors_are_counted_by_kind_and_others_are_nobodys(tmp_path: Path) -> None:
    mine = str(os.getpid())
    lines = {
        mine: "ray::MachineActor.report",
        "4000001": "ray::SourceActor",
        "4000002": "vim ray::MachineActor",
    }
    found = samples(NodeCollector([], made_up_proc(tmp_path / "proc", lines)))
    counts = {k: found["searchlight_node_actors", k] for k in ("machine", "source", "reducer", "scheduler")}
    assert counts == {"machine": 1.0, "source": 0.0, "reducer": 0.0, "scheduler": 0.0}, "4000001 has ended"
    assert found["searchlight_node_actor_memory_bytes", "machine"] > 10e6


def test_a_process_says_what_it_uses() -> None:
    usage = Usage()
    assert usage.memory_bytes == pytest.approx(resident_bytes(str(os.getpid())), rel=0.2)
    assert usage.cpu_s > 0.0


def test_the_command_serves_until_it_is_told_to_end_and_names_its_sites() -> None:
    command = [sys.executable, "-m", "actors", "node-metrics", "--port", "0"]
    env = os.environ | {"SEARCHLIGHT_SITES": "drone-1 van"}
    process = subprocess.Popen(
        command, cwd=ROOT, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        assert process.stdout is not None
        address = process.stdout.readline().split()[-1]
        with urllib.request.urlopen(address) as answer:
            text = answer.read().decode()
        assert 'sites="drone-1 van"' in text
        assert "searchlight_node_memory_available_bytes" in text
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0
    finally:
        process.kill()
        process.wait()
