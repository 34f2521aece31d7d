"""The shipped family has seen simulated people only: a mission on other videos is told so, once."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml

from pipeline.config.pool import load_pool
from pipeline.detection import load_detector, open_pool_detector
from pipeline.mission.prepared import prepare
from pipeline.mission.simulated_only import is_simulated, knows_simulation_only, simulated_only

CONFIGS = Path(__file__).parents[3] / "configs"
DEMO = CONFIGS / "missions" / "demo"


@pytest.mark.parametrize("name", ["nano", "small", "medium", "large"])
def test_the_files_of_the_family_say_what_they_were_trained_on(name):
    assert knows_simulation_only(load_detector(CONFIGS / "detectors" / f"{name}.onnx", score_threshold=0.5))


@pytest.mark.parametrize("pool", ["demo", "simulated"])
def test_the_pools_are_of_these_files(pool):
    for row in load_pool(CONFIGS / "pools" / f"{pool}.yaml").detectors:
        assert knows_simulation_only(open_pool_detector(row))


def test_simulate_s_videos_are_known_by_the_truth_beside_them(tmp_path):
    assert is_simulated(DEMO / "drone-1.mp4")
    assert not is_simulated(DEMO / "drone-3.mp4")
    (tmp_path / "truth").mkdir()
    (tmp_path / "truth" / "boxes-flight.json").write_text('{"images": [{"file_name": "other.mp4#0"}]}')
    assert not is_simulated(tmp_path / "flight.mp4")
    for broken in ("", "[]", '{"images": []}', '{"images": 3}', '{"images": [{}]}', "[" * 100_000):
        (tmp_path / "truth" / "boxes-flight.json").write_text(broken)
        assert not is_simulated(tmp_path / "flight.mp4")


def test_one_line_names_the_detectors_and_the_first_such_video(tmp_path):
    files = [DEMO / "drone-1.mp4", tmp_path / "mine.mp4", tmp_path / "other.mp4"]
    videos = [("ground", file) for file in files]
    (finding,) = simulated_only(["small", "medium"], videos)
    line = str(finding)
    assert line.startswith(
        "warning: detectors small, medium: trained on simulated scenes only, and mine.mp4 is"
    )
    assert "\n" not in line
    assert simulated_only([], videos) == []
    assert simulated_only(["small"], videos[:1]) == []


def test_a_mission_on_another_video_is_warned_and_the_simulated_one_is_not(small_mission, tmp_path):
    causes = [f.cause for f in prepare(small_mission).findings]
    assert "simulated_detector" not in causes
    folder = tmp_path / "mission"
    shutil.copytree(small_mission.parent, folder)
    document = yaml.safe_load((folder / "mission.yaml").read_text())
    (folder / "drone-1.mp4").rename(folder / "mine.mp4")
    document["streams"][0]["video"] = "mine.mp4"
    (folder / "mission.yaml").write_text(yaml.safe_dump(document))
    (found,) = [f for f in prepare(folder / "mission.yaml").findings if f.cause == "simulated_detector"]
    assert (found.severity, "mine.mp4" in found.found) == ("warning", True)
