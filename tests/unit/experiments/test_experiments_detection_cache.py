from dataclasses import replace

import numpy as np
import pytest

from pipeline.experiments import detection_cache
from pipeline.experiments.detection_cache import detections_of
from pipeline.experiments.pose_errors import STATED, mission_with_pose_errors
from pipeline.experiments.refusion import fuse_again
from pipeline.mission.local import run_local
from pipeline.mission.planning import plan
from pipeline.mission.prepared import prepare


def quiet(*_: object) -> None:
    """Say nothing."""


@pytest.fixture(scope="module")
def cached(small_mission, tmp_path_factory):
    """The prepared mission, its cache and what was detected."""
    prepared, cache = prepare(small_mission), tmp_path_factory.mktemp("cache") / "detections.msgpack"
    return prepared, cache, detections_of(prepared, cache, quiet)


def test_fusing_kept_detections_gives_the_map_of_a_run(cached):
    prepared, _, results = cached
    again = fuse_again(prepared, results, prepared.mission.fusion)
    fusion = prepared.mission.fusion.model_copy(update={"update_rule": "paper"})
    by_the_paper = replace(prepared, mission=prepared.mission.model_copy(update={"fusion": fusion}))
    run = run_local(by_the_paper, plan(prepared), quiet)
    np.testing.assert_array_equal(again.fuser.map.log_odds, run.reducer.fuser.map.log_odds)


def test_kept_detections_are_read_not_made_again(cached, monkeypatch):
    prepared, cache, results = cached
    monkeypatch.setattr(detection_cache, "_detect", lambda *_: pytest.fail("detected again"))
    again = detections_of(prepared, cache, quiet)
    assert [r.order for r in again] == [r.order for r in results]
    for one, other in zip(again, results, strict=True):
        np.testing.assert_array_equal(one.boxes_px, other.boxes_px)


def test_a_spoiled_cache_and_one_of_another_plan_are_made_again(cached, monkeypatch, tmp_path):
    prepared, cache, results = cached
    monkeypatch.setattr(detection_cache, "_detect", lambda *_: results)
    spoiled = tmp_path / "spoiled.msgpack"
    for content in (cache.read_bytes()[:-50], b"", cache.read_bytes().replace(b"\xd9\x40", b"\xd9\x41", 1)):
        spoiled.write_bytes(content)
        assert len(detections_of(prepared, spoiled, quiet)) == len(results)
        assert detection_cache._read(spoiled, detection_cache._key(prepared, plan(prepared))) is not None
    assert detection_cache._read(cache, "another key") is None


def test_pose_errors_change_the_telemetry_and_keep_boxes_and_true_places(cached, small_mission, tmp_path):
    prepared, cache, results = cached
    disturbed = prepare(mission_with_pose_errors(small_mission, tmp_path / "flight", 0))
    moved = detections_of(disturbed, cache, quiet)
    assert disturbed.mission.truth.resolve() == prepared.mission.truth.resolve()
    apart = np.array([a.pose.position_enu - b.pose.position_enu for a, b in zip(moved, results, strict=True)])
    assert 0.05 < np.abs(apart).mean() < 2.0
    for a, b in zip(moved, results, strict=True):
        np.testing.assert_array_equal(a.boxes_px, b.boxes_px)


def test_the_same_number_gives_the_same_telemetry_and_another_one_another(small_mission, tmp_path):
    texts = []
    for name, number in (("a", 1), ("b", 1), ("c", 2)):
        folder = mission_with_pose_errors(small_mission, tmp_path / name, number).parent
        texts.append((folder / "drone-1.srt").read_text(encoding="utf-8"))
    assert texts[0] == texts[1] != texts[2]


def test_a_mission_with_pose_errors_states_them_in_every_pose(small_mission, tmp_path):
    """Poses between samples carry what the mission states: stated only later, they would keep the exact mission's."""
    disturbed = prepare(mission_with_pose_errors(small_mission, tmp_path / "flight", 0))
    assert disturbed.mission.fusion.uncertainty.model_dump() == pytest.approx(STATED.model_dump())
    stated = [
        stream.trajectory.pose(t)
        for stream in disturbed.streams
        for t in np.linspace(stream.trajectory.times_s[0], stream.trajectory.times_s[-1], 60)
    ]
    assert any(p.horizontal_sd_m >= STATED.position_bias for p in stated)
    assert all(not p.horizontal_sd_m < STATED.position_bias - 1e-9 for p in stated)
    assert all(not p.attitude_sd_rad < STATED.attitude_bias - 1e-9 for p in stated)
