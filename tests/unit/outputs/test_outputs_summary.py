import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.outputs.report import ReportData
from pipeline.outputs.summary import Latency, LinkUse, _link, write_summary
from pipeline.storage.whole_or_nothing import check_run_directory

Search = Callable[..., ReportData]


def strict(path: Path) -> dict[str, Any]:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    loaded = json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)
    assert isinstance(loaded, dict)
    return loaded


def test_the_summary_holds_what_the_run_did(search: Search, tmp_path: Path) -> None:
    write_summary(tmp_path / "summary.json", search().summary)
    summary = strict(tmp_path / "summary.json")
    assert summary["plan"] == {"status": "optimal", "objective": 1.23, "gap": 0.0, "assignments": 2}
    for stream in summary["streams"]:
        assert stream["captured"] == stream["processed"] + sum(stream["dropped"].values())
    assert summary["links"][0]["share"] == pytest.approx(0.4833)
    assert summary["links"][1]["bandwidth_bps"] is None
    assert summary["truth"]["people"] == 3
    assert summary["truth"]["false"] == [3]
    assert summary["truth"]["missed"] == ["half hidden"]
    assert len(summary["truth"]["found"]) == 2
    assert summary["substreams"][0]["latency"]["detect"]["p99_at_most_s"] == 0.1
    assert summary["substreams"][1]["latency"] == {}


def test_a_summary_marks_its_folder_as_ours(search: Search, tmp_path: Path) -> None:
    write_summary(tmp_path / "summary.json", search().summary)
    check_run_directory(tmp_path)


def test_what_is_not_a_number_becomes_null(search: Search, tmp_path: Path) -> None:
    summary = search().summary
    substream = dataclasses.replace(summary.substreams[0], hops={"hold": Latency(math.nan, math.inf, 0.0)})
    plan = dataclasses.replace(summary.plan, objective=None, gap=math.nan)
    write_summary(tmp_path / "a", dataclasses.replace(summary, substreams=[substream], plan=plan))
    content = strict(tmp_path / "a")
    latency = {"mean_s": None, "median_at_most_s": None, "p99_at_most_s": 0.0}
    assert content["substreams"][0]["latency"] == {"hold": latency}
    assert content["plan"]["gap"] is None


def test_numbers_of_numpy_are_written_as_numbers(search: Search, tmp_path: Path) -> None:
    summary = search().summary
    place = dataclasses.replace(summary.locations[0], probability=np.float32(0.5), looks=np.int64(3))  # type: ignore[arg-type]
    write_summary(tmp_path / "a", dataclasses.replace(summary, locations=[place]))
    assert strict(tmp_path / "a")["found"][0]["looks"] == 3


def test_nothing_of_the_environment_gets_in(
    search: Search, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RAY_AUTH_TOKEN", "s3cr3t-token")
    write_summary(tmp_path / "a", search().summary)
    assert "s3cr3t" not in (tmp_path / "a").read_text()


def test_a_link_without_a_limit_or_without_time_has_no_share() -> None:
    assert LinkUse("s", "van", math.inf, 10, 1.0).share is None
    assert _link(LinkUse("s", "van", 6e6, 10, 1.0))["least_measured_bps"] is None
    measured = _link(LinkUse("s", "van", 6e6, 10, 1.0, 0.48e6, 3))
    assert (measured["least_measured_bps"], measured["lost_messages"]) == (480000.0, 3)
    assert LinkUse("s", "van", 0.0, 0, 1.0).share is None
    assert LinkUse("s", "van", 1e6, 10, 0.0).mean_bps == 0.0
    assert LinkUse("s", "van", 1e6, 62_500, 1.0).share == pytest.approx(0.5)
