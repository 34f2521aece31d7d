"""A run in real time, in a process of its own, that a test watches, strikes and judges while it goes on."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.listening import listening

ROOT = Path(__file__).resolve().parents[1]
#: how Ray names the process of the actor that reports itself to nobody
SCHEDULER = "^ray::SchedulerActor"


@dataclass
class LiveRun:
    """mission: its file. out: the run directory. options: more of the command line."""

    mission: Path
    out: Path
    options: Sequence[str] = ()
    _process: Any = field(init=False)

    def __post_init__(self) -> None:
        command = [sys.executable, "-m", "actors.cli", "run", str(self.mission), "--out", str(self.out)]
        self._process = subprocess.Popen(
            [*command, "--pace", "realtime", *self.options],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    @property
    def is_over(self) -> bool:
        """Whether its process has ended."""
        return self._process.poll() is not None

    def listening(self) -> dict[tuple[str, int], str]:
        """See ``tests.listening``."""
        return listening(self._process.pid)

    def events(self) -> list[dict[str, Any]]:
        """What its log says so far."""
        lines: list[str] = []
        for path in self.out.parent.glob(f".{self.out.name}.*.log.part"):
            lines += path.read_text(encoding="utf-8").splitlines()
        return [json.loads(line) for line in lines if line.endswith("}")]

    def wait_for(self, event: str, subject: str = "", after: int = 0) -> dict[str, Any]:
        """The event, once it is there; after: the events before are not looked at."""
        until = time.monotonic() + 120.0
        while time.monotonic() < until and not self.is_over:
            for found in self.events()[after:]:
                if found["event"] == event and found.get("subject", "") == subject:
                    return found
            time.sleep(0.1)
        raise AssertionError(f"no {event} {subject}: {self._process.communicate(timeout=60)[0]}")

    def process_of(self, actor: str) -> int | None:
        """The number of an actor's newest process; None if it has none that is known."""
        if actor == "scheduler":
            found = subprocess.run(["pgrep", "-n", "-f", SCHEDULER], capture_output=True, check=False)
            return int(found.stdout) if found.stdout else None
        ups = [e for e in self.events() if e["event"] == "up" and e["subject"] == actor]
        return int(str(ups[-1]["detail"]).split()[1]) if ups else None

    def strike(self, actor: str, number: signal.Signals) -> int:
        """Signal an actor's process; how many events there were before."""
        before, process = len(self.events()), self.process_of(actor)
        assert process is not None, actor
        os.kill(process, number)
        return before

    def end(self, within_s: float = 240.0) -> dict[str, Any]:
        """Its summary, once it has ended well."""
        said, _ = self._process.communicate(timeout=within_s)
        assert self._process.returncode == 0, said
        assert "(raylet)" not in said, "who died is said in our words"
        return dict(json.loads((self.out / "summary.json").read_text(encoding="utf-8")))

    def give_up(self) -> None:
        """End it, however it is."""
        self._process.kill()
        self._process.communicate()


def is_accounted_for(summary: dict[str, Any], *, least: int = 1) -> None:
    """Every captured and every offered frame was processed, or dropped for a reason. least: processed of a stream."""
    assert summary["partial"] is None
    for stream in summary["streams"]:
        assert stream["captured"] == stream["processed"] + sum(stream["dropped"].values()), stream
        assert stream["processed"] >= least, stream
    for substream in summary["substreams"]:
        accounted = substream["processed"] + sum(substream["dropped"].values())
        assert substream["offered"] == accounted, substream
