"""A real mission in real time, watched in a real browser from its begin to its end."""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.ray,
    pytest.mark.xdist_group("ray"),
    pytest.mark.timeout(400),
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium (Debian: apt-get install chromium)"),
]


def cpu_s(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def started(*arguments: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-u", "-m", "actors", *arguments],
        cwd=ROOT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )


def test_the_page_follows_a_mission_and_ends_with_its_summary(tmp_path: Path) -> None:
    from playwright.sync_api import sync_playwright

    out = tmp_path / "run"
    mission = str(ROOT / "configs/missions/demo/mission.yaml")
    with (tmp_path / "run.log").open("w") as log:
        run = subprocess.Popen(
            [sys.executable, "-m", "actors", "run", mission, "--pace", "realtime", "--out", str(out)],
            stdout=log,
            stderr=log,
            cwd=ROOT,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
        )
    try:
        while not (out / "live/status.json").is_file():
            assert run.poll() is None, (tmp_path / "run.log").read_text()
            time.sleep(0.2)
        view = started("view", str(out), "--port", "0")
        try:
            assert view.stdout is not None
            address = next(word for word in view.stdout.readline().split() if word.startswith("http://"))
            with sync_playwright() as driver:
                browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
                page = browser.new_page()
                page.goto(address)
                page.wait_for_selector("body[data-ready=yes]")
                began, used = time.monotonic(), cpu_s(view.pid)
                ages, found = [], []
                while run.poll() is None:
                    state = page.evaluate("[state.now.state, (state.now.run.reducer || {}).at || '']")
                    if state[0] == "flying" and state[1] and "ended" not in page.inner_text("#going"):
                        at = datetime.fromisoformat(state[1])
                        ages.append((datetime.now(UTC) - at).total_seconds())
                        found.append(int(page.inner_text("#found-head").split()[1]))
                    time.sleep(0.1)
                share = (cpu_s(view.pid) - used) / (time.monotonic() - began)
                page.wait_for_selector("#state:has-text('finished')", timeout=20_000)
                summary = json.loads((out / "summary.json").read_text())
                assert page.inner_text("#found-head") == f"Found: {len(summary['found'])}"
                assert page.inner_text("#possible-head") == f"Possible: {len(summary['possible'])}"
                assert page.inner_text("#verdict") == summary["verdict"]["sentence"]
                browser.close()
        finally:
            view.terminate()
            view.wait(10)
    finally:
        run.terminate()
        run.wait(60)
    assert run.returncode == 0, (tmp_path / "run.log").read_text()
    ages.sort()
    print(
        f"age of what is shown, s: median {statistics.median(ages):.2f}, 95 % {ages[int(0.95 * len(ages))]:.2f}, "
        f"most {ages[-1]:.2f}; the server's share of one core {share:.3f}; places {found[0]} to {max(found)}"
    )
    assert found[0] < max(found)  # it grew while somebody looked
    assert statistics.median(ages) <= 3.0
    assert share < 0.2
