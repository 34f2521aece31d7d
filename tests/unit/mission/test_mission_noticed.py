"""What is said of a mission is true of it: no alarm for what was asked for, and simulated telemetry does not lie."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.mission.noticed import noticed
from pipeline.mission.prepared import PreparedMission, prepare


def changed(small_mission: Path, name: str, changes: dict[str, Any]) -> PreparedMission:
    mission = yaml.safe_load(small_mission.read_text(encoding="utf-8"))
    for stream in mission["streams"]:
        stream.update(changes)
        for key in [key for key, value in changes.items() if value is None]:
            del stream[key]
    path = small_mission.parent / name
    path.write_text(yaml.safe_dump(mission), encoding="utf-8")
    try:
        return noticed(prepare(path))
    finally:
        path.unlink()


@pytest.mark.parametrize("end_s", [0.6, 1.2, 2.0])
def test_a_part_of_a_video_is_no_telemetry_of_another_duration(small_mission: Path, end_s: float) -> None:
    prepared = changed(small_mission, "part.yaml", {"end": {"seconds": end_s}})
    assert "duration" not in {finding.cause for finding in prepared.findings}


def test_a_simulated_flight_tells_the_focal_length_of_its_camera(small_mission: Path) -> None:
    whole = changed(small_mission, "whole.yaml", {})
    told = changed(small_mission, "told.yaml", {"camera": None})
    for stream, camera in told.cameras.items():
        assert camera.fx == pytest.approx(whole.cameras[stream].fx, rel=1e-3)
        assert camera.focal_sd == 0.10
