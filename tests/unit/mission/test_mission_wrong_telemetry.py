"""Missions with a fault in their telemetry, from the files to what is said of them."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.mission.prepared import prepare


@pytest.fixture
def mission(small_mission: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(small_mission.parent, tmp_path / "mission")) / "mission.yaml"


def rewritten(path: Path, pattern: str, by: str) -> None:
    text, count = re.subn(pattern, by, path.read_text(encoding="utf-8"))
    assert count > 10
    path.write_text(text, encoding="utf-8")


def test_latitude_and_longitude_exchanged_in_one_stream_are_named_before_ground_is_looked_for(
    mission: Path,
) -> None:
    srt = mission.parent / "drone-2.srt"
    rewritten(srt, r"\[latitude: ([-\d.]+)\] \[longitude: ([-\d.]+)\]", r"[latitude: \2] [longitude: \1]")
    with pytest.raises(InputError, match="with latitude and longitude exchanged they lie on it") as refused:
        prepare(mission)
    assert "drone-2.srt" in str(refused.value)


def test_flights_hours_apart_are_said_and_believed(mission: Path) -> None:
    rewritten(mission.parent / "drone-2.srt", r"2026-06-14 09:30:", "2026-06-14 11:37:")
    findings = prepare(mission).findings
    (apart,) = [f for f in findings if f.cause == "time_apart"]
    assert (apart.severity, apart.where) == ("assumed", "drone-2")
    assert "begins 2.1 h after" in apart.found
    assert "telemetry.utc_offset +7620 s" in apart.mend
