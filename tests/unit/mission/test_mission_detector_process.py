"""A detector in a process of its own finds what one in a thread finds, and takes nobody with it when it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from actors.machine import MachineActor, MachineParams
from pipeline.allocation.plan import Assignment
from pipeline.clock import Clock
from pipeline.config.pool import PoolDetector, load_pool
from pipeline.detection import PERSONS, open_pool_detector
from pipeline.errors import InputError, RunFailedError
from pipeline.mission.controller.orders import Run
from pipeline.mission.controller.substreams import Opened
from pipeline.mission.stages.detector_process import DetectorProcess, ProcessParams
from pipeline.mission.stages.inbox import InboxParams
from pipeline.mission.stages.machine import MachineStage

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def small() -> PoolDetector:
    return next(d for d in load_pool(ROOT / "configs/pools/demo.yaml").detectors if d.id == "small")


@pytest.fixture
def process(small: PoolDetector) -> Iterator[DetectorProcess]:
    detector = DetectorProcess(small, PERSONS, None, ProcessParams(look_s=20.0))
    yield detector
    detector.close()


def pictures() -> list[np.ndarray]:
    """Of several sizes, small ones between large ones; in noise the network sees somebody now and then."""
    rng = np.random.default_rng(3)
    sizes = (288, 512), (576, 1024), (96, 64), (1080, 1920), (288, 512)
    return [
        np.kron(rng.integers(0, 256, (h // 16 + 1, w // 16 + 1, 3)), np.ones((16, 16, 1)))[:h, :w].astype(
            np.uint8
        )
        for h, w in sizes
    ]


def is_gone(pid: int) -> bool:
    """Within a while; one that nobody has buried yet is gone too."""
    until = time.monotonic() + 20.0
    while time.monotonic() < until:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except FileNotFoundError:
            return True
        if state == "Z":
            return True
        time.sleep(0.05)
    return False


def test_it_finds_what_a_thread_finds(process: DetectorProcess, small: PoolDetector) -> None:
    thread = open_pool_detector(replace_threshold(small))
    other = DetectorProcess(replace_threshold(small), PERSONS)
    found = 0
    for picture in pictures():
        expected, got = thread.detect(picture), other.detect(picture)
        for mine, theirs in zip(expected, got, strict=True):
            assert mine.dtype == theirs.dtype
            np.testing.assert_array_equal(mine, theirs)
        found += len(got[0])
    other.close()
    assert found, "boxes have crossed"


def replace_threshold(detector: PoolDetector) -> PoolDetector:
    return detector.model_copy(update={"score_threshold": 0.001})


def test_one_that_is_killed_says_how_and_another_goes_on(
    process: DetectorProcess, small: PoolDetector
) -> None:
    other = DetectorProcess(small, PERSONS)
    process.detect(pictures()[0])
    os.kill(process.pid, signal.SIGKILL)
    with pytest.raises(RunFailedError, match=r"detector small: its process has ended \(SIGKILL\)"):
        process.detect(pictures()[0])
    other.detect(pictures()[0])
    other.close()


def test_one_that_hangs_is_ended_and_that_is_said(small: PoolDetector) -> None:
    hangs = DetectorProcess(small, PERSONS, None, ProcessParams(look_s=0.5))
    hangs.detect(pictures()[2])
    os.kill(hangs.pid, signal.SIGSTOP)
    with pytest.raises(RunFailedError, match=r"its process hangs for 0\.5 s"):
        hangs.detect(pictures()[2])
    assert is_gone(hangs.pid)


def test_what_cannot_be_loaded_is_the_same_error(small: PoolDetector) -> None:
    wrong = small.model_copy(update={"sha256": "0" * 64})
    with pytest.raises(InputError) as here:
        open_pool_detector(wrong)
    with pytest.raises(InputError) as there:
        DetectorProcess(wrong, PERSONS)
    assert str(there.value) == str(here.value)


def test_it_does_not_outlive_whom_it_is_for(process: DetectorProcess) -> None:
    code = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from pipeline.config.pool import load_pool\n"
        "from pipeline.mission.stages.detector_process import DetectorProcess\n"
        f"pool = load_pool(Path({str(ROOT / 'configs/pools/demo.yaml')!r}))\n"
        "one = DetectorProcess(pool.detectors[0], {'person': 0})\n"
        "print(one.pid, flush=True)\n"
        "time.sleep(100)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    assert is_gone(child)
    pid = process.pid
    process.close()
    assert is_gone(pid)


def test_on_a_machine_its_death_costs_its_own_substream_alone(small: PoolDetector) -> None:
    made: dict[str, DetectorProcess] = {}

    def load(assignment: Assignment) -> DetectorProcess:
        made[assignment.detector] = DetectorProcess(small, PERSONS)
        return made[assignment.detector]

    stage = MachineStage(
        "m", "h264", load, lambda *_: None, lambda *_: None, InboxParams(), Clock(), drops=True
    )
    opened = [Opened(0, Assignment("v", f"m:{k}", "small", "m", "s", 1, 0, 1e6)) for k in range(2)]
    stage.run(Run("m", tuple(opened)))
    stage.wait_ready()
    os.kill(made["m:0"].pid, signal.SIGKILL)
    from tests.unit.mission.test_mission_machine_stage import packets

    for of in opened:
        stage.put(packets(of, 1)[0])
    until = time.monotonic() + 20.0
    while not stage.report().failed and time.monotonic() < until:
        time.sleep(0.02)
    (failed,) = stage.report().failed
    assert (failed.substream, "SIGKILL" in failed.reason) == (opened[0].key, True)
    assert stage.report().running == {opened[1].key}
    stage.run(Run("m", (), 0, 1))


def test_a_machine_opens_its_networks_as_the_mission_says(
    monkeypatch: pytest.MonkeyPatch, small: PoolDetector
) -> None:
    calls: list[tuple[str, str, object]] = []

    def noted(how: str):
        return lambda row, layers, setup: calls.append((how, row.id, setup))

    monkeypatch.setattr("actors.machine.DetectorProcess", noted("process"))
    monkeypatch.setattr("actors.machine.open_pool_detector", noted("thread"))
    assignment = Assignment("v", "m:small", "small", "m", "s", 1, 0, 4e6)
    for processes in (True, False):
        machine = MachineActor("m", "127.0.0.1", "h264", replace(MachineParams(), processes=processes))
        machine._opened(assignment, small, PERSONS)
    assert calls == [("process", "small", assignment.setup), ("thread", "small", assignment.setup)]
