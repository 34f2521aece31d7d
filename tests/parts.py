"""A pytest plugin: the whole test suite in parts that can be interrupted, each with its results in a dated file.

    python -m pytest -p tests.parts -m "" --part 3/12

The 1st, 1 + n-th, .. collected test are of the first part and so on: cases of a slow test are spread over all
parts. What passed is written down as it passes, in ``runs/tests/DATE-part-3-of-12.json``; run again on the same source
with the same part, only the rest is run. The file holds the digest of the source, and outcome and seconds of each test.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from pipeline.storage.whole_or_nothing import make_folder, write_text

_ROOT = Path(__file__).resolve().parents[1]
_FOLDER = Path("runs/tests")
#: what is tested, and by what
_SOURCE = ("pipeline", "actors", "tests", "configs", "deployments")


def pytest_addoption(parser: pytest.Parser) -> None:
    """--part, --results."""
    group = parser.getgroup("parts")
    group.addoption("--part", default="1/1", help="k/n: the k-th of n parts")
    group.addoption("--results", default=str(_FOLDER), help="folder of the results")


def pytest_configure(config: pytest.Config) -> None:
    """Raises UsageError for a part that is none."""
    part = part_of(config.getoption("--part"))
    folder = Path(config.getoption("--results"))
    config.pluginmanager.register(Part(*part, folder, _source_sha256()), "part of the suite")


def part_of(words: str) -> tuple[int, int]:
    """k and n of "k/n". Raises UsageError unless 1 <= k <= n."""
    k, _, n = words.partition("/")
    if not (k.isascii() and n.isascii() and k.isdigit() and n.isdigit() and 1 <= int(k) <= int(n)):
        raise pytest.UsageError(f"--part: found {words!r}; expected k/n with 1 <= k <= n, such as 3/12")
    return int(k), int(n)


def _source_sha256() -> str:
    digest = hashlib.sha256()
    for folder in _SOURCE:
        for path in sorted((_ROOT / folder).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                name = str(path.relative_to(_ROOT)).encode("utf-8")
                digest.update(name + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


class Part:
    """One part of the suite, and what came of it. folder: of the results. source: digest of what is tested."""

    def __init__(self, number: int, count: int, folder: Path, source: str) -> None:
        self.number, self.count = number, count
        self._folder, self._source = folder, source
        self._path, self._results = self._begin()

    def _begin(self) -> tuple[Path, dict[str, dict[str, Any]]]:
        """The newest file of this part and source, with what it holds; or a new one of today."""
        of_part = f"part-{self.number}-of-{self.count}.json"
        for path in sorted(self._folder.glob(f"*-{of_part}"), reverse=True):
            held = json.loads(path.read_text(encoding="utf-8"))
            if held["source"] == self._source:
                return path, held["tests"]
        return self._folder / f"{datetime.now(UTC):%Y-%m-%dT%H%M%S}-{of_part}", {}

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        """Keep what is of this part and has not passed."""
        mine = items[self.number - 1 :: self.count]
        left = [
            item
            for item in mine
            if self._results.get(item.nodeid, {}).get("outcome") not in ("passed", "skipped")
        ]
        kept = set(left)
        config.hook.pytest_deselected(items=[item for item in items if item not in kept])
        items[:] = left

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add a phase of a test to its result; at its end write all down."""
        result = self._results.setdefault(report.nodeid, {"outcome": "passed", "seconds": 0.0})
        if report.when == "setup":
            result |= {
                "outcome": "passed",
                "seconds": 0.0,
                "began": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}",
            }
        result["seconds"] = round(result["seconds"] + report.duration, 3)
        if report.outcome != "passed":
            result["outcome"] = report.outcome
        if report.when == "teardown":
            self._write()

    def _write(self) -> None:
        make_folder(self._folder)
        document = {
            "part": f"{self.number}/{self.count}",
            "source": self._source,
            "seconds": round(sum(result["seconds"] for result in self._results.values()), 1),
            "outcomes": self.outcomes,
            "tests": self._results,
        }
        write_text(self._path, json.dumps(document, indent=1) + "\n")

    @property
    def outcomes(self) -> Mapping[str, int]:
        """How many tests of each outcome."""
        found = [result["outcome"] for result in self._results.values()]
        return {outcome: found.count(outcome) for outcome in sorted(set(found))}

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Where the results are."""
        if self._results:
            counts = ", ".join(f"{count} {outcome}" for outcome, count in self.outcomes.items())
            terminalreporter.write_line(f"part {self.number} of {self.count}: {counts}; {self._path}")
