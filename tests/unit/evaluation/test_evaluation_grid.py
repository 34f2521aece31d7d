"""The grid: nothing is done twice, nothing is left out in silence."""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.config.evaluation import load_evaluation
from pipeline.config.pool import Calibration
from pipeline.errors import InputError
from pipeline.evaluation.datasets.fault_log import FaultLog
from pipeline.evaluation.datasets.read_datasets import read_datasets
from pipeline.evaluation.measuring import grid as grid_module
from pipeline.evaluation.measuring.cache import Cache
from pipeline.evaluation.measuring.grid import in_processes, plan_grid, run_grid
from pipeline.evaluation.measuring.grid_results import GridResults, cells_of, score_use
from pipeline.evaluation.measuring.unit import Model
from pipeline.evaluation.measuring.work_unit import Found, UnitResult

NANO = Path(__file__).parents[3] / "configs/detectors/nano.onnx"
MODEL = Model("nano", NANO, "0" * 64)


def evaluation(small_mission, tmp_path, **changes):
    document = {
        "name": "test",
        "datasets": [{"format": "mission", "path": str(small_mission)}],
        "detectors": [{"id": "nano", "model": str(NANO)}],
        "transcoding": {
            "codecs": ["h264", "vp9"], "bitrates": [{"kbps": 100}, {"mbps": 1}], "width": 512, "height": 288,
        },
    } | changes  # fmt: skip
    path = tmp_path / "evaluation.yaml"
    path.write_text(yaml.safe_dump(document))
    return load_evaluation(path)


def result(units, not_finite=0):
    """What a perfect stranger would find: nothing."""
    for unit in units:
        found = Found(np.zeros(0, np.int64), np.zeros((0, 4)), np.zeros(0), not_finite, 0.5)
        yield unit, UnitResult(1000, 100, len(unit.kept), {"encode": 1.0}, {m.id: found for m in unit.models})


@pytest.fixture
def planned(small_mission, tmp_path):
    asked = evaluation(small_mission, tmp_path)
    dataset = read_datasets(asked, FaultLog(asked.faults))
    return asked, dataset, plan_grid(asked, dataset, (MODEL,))


def run(planned, cache, execute, policy=None):
    asked, dataset, grid = planned
    return run_grid(grid, dataset, cache, FaultLog(policy or asked.faults), execute, lambda *_: None)


def test_every_sequence_meets_every_condition_and_the_pictures_as_they_are(planned):
    _, dataset, grid = planned
    assert [str(c) for c in grid.conditions] == [
        "source", "h264 at 100 kbps", "h264 at 1000 kbps", "vp9 at 100 kbps", "vp9 at 1000 kbps",
    ]  # fmt: skip
    assert len(grid.units) == len(dataset.sequences) * len(grid.conditions) == 10
    for unit in grid.units:
        assert set(unit.looked) <= set(unit.kept)
        assert len(unit.looked) > 5


def test_what_was_finished_before_an_interruption_is_not_done_again(planned, tmp_path):
    cache, done = Cache(tmp_path / "cache"), []

    def interrupted(units):
        for k, pair in enumerate(result(units)):
            if k == 4:
                raise KeyboardInterrupt
            done.append(pair[0])
            yield pair

    with pytest.raises(KeyboardInterrupt):
        run(planned, cache, interrupted)
    again = []

    def counted(units):
        again.extend(units)
        return result(units)

    assert len(run(planned, cache, counted)) == 10
    assert len(done) == 4
    assert len(again) == 6
    assert not {(u.sequence, u.condition) for u in done} & {(u.sequence, u.condition) for u in again}
    run(planned, cache, lambda units: pytest.fail("nothing is left to do"))


def test_a_new_detector_works_alone(planned, tmp_path):
    asked, dataset, _ = planned
    cache = Cache(tmp_path / "cache")
    run(planned, cache, result)
    second = Model("other", NANO, "1" * 64)
    both = (asked, dataset, plan_grid(asked, dataset, (MODEL, second)))
    seen = []

    def counted(units):
        seen.extend(m.id for u in units for m in u.models)
        return result(units)

    results = run(both, cache, counted)
    assert seen == ["other"] * 10
    assert all(set(r.found) == {"nano", "other"} for r in results.values())


def test_a_detector_that_returns_nan_is_refused_or_counted(planned, tmp_path):
    asked, dataset, grid = planned
    with pytest.raises(InputError, match=r"nano.onnx on drone-\d, .*3 detections that are NaN"):
        run(planned, Cache(tmp_path / "a"), lambda units: result(units, not_finite=3))
    log = FaultLog(asked.faults.model_copy(update={"not_finite": "skip"}))
    run_grid(
        grid, dataset, Cache(tmp_path / "b"), log, lambda units: result(units, not_finite=3), lambda *_: None
    )
    assert log.counts == {"not_finite": 30}


def test_a_codec_that_is_missing_is_named(planned, monkeypatch):
    asked, dataset, _ = planned
    monkeypatch.setattr(grid_module, "available_codecs", lambda: ("h264",))
    grid = plan_grid(asked, dataset, (MODEL,))
    assert grid.missing_codecs == ("vp9",)
    assert {c.codec for c in grid.conditions} == {None, "h264"}
    monkeypatch.setattr(grid_module, "available_codecs", lambda: ("vp9",))
    with pytest.raises(InputError, match=r"pool.codec: found h264, which this build of FFmpeg lacks"):
        plan_grid(asked, dataset, (MODEL,))


def test_processes_give_what_one_process_gives(planned):
    _, _, grid = planned
    units = [
        replace(u, kept=u.kept[:20], looked={u.kept[0]: 0, u.kept[15]: 5})
        for u in grid.units
        if str(u.condition) in ("source", "h264 at 100 kbps")
    ]
    alone = {(u.sequence, u.condition): r for u, r in in_processes(1)(units)}
    apart = {(u.sequence, u.condition): r for u, r in in_processes(2)(units)}
    assert alone.keys() == apart.keys()
    for key, one in alone.items():
        np.testing.assert_array_equal(one.found["nano"].boxes_px, apart[key].found["nano"].boxes_px)
        assert one.total_bytes == apart[key].total_bytes


def test_cells_hold_the_bitrate_obtained_and_the_largest_packet(planned, tmp_path):
    asked, dataset, grid = planned
    found = GridResults(asked, dataset, grid, run(planned, Cache(tmp_path / "c"), result))
    cells = cells_of(found, lambda *_: None)
    assert cells_of(found, lambda *_: None, workers=3) == cells
    use = score_use(found, "nano")
    assert (use.threshold, use.calibration) == (1.0, None)  # best to report nothing
    assert len(cells) == 5
    frames = sum(len(u.kept) for u in grid.units if u.condition == grid.conditions[1])
    assert cells[1].obtained_bps == pytest.approx(8 * 2 * 1000 / (frames / 30.0))
    assert cells[1].largest_packet_s == pytest.approx(8 * 100 / 100e3)
    assert cells[0].obtained_bps is None
    # nobody was found
    assert (cells[1].figures.ap, cells[1].figures.molrp, cells[1].figures.threshold) == (0.0, 1.0, None)


def test_a_threshold_and_calibration_from_other_pictures_are_kept(planned, tmp_path):
    asked, dataset, grid = planned
    given = {"score_threshold": 0.4, "calibration": Calibration(scale=2.0, offset=0.1)}
    detectors = (asked.detectors[0].model_copy(update=given),)
    asked = asked.model_copy(update={"detectors": detectors})
    found = GridResults(asked, dataset, grid, run(planned, Cache(tmp_path / "c"), result))
    use = score_use(found, "nano")
    assert (use.threshold, use.calibration) == (0.4, given["calibration"])


def test_a_card_gives_the_threshold_and_calibration_that_its_training_found(small_mission, tmp_path):
    card = tmp_path / "a.card.yaml"
    scores = {"threshold": 0.41, "rule": "of a line", "calibration": {"scale": 1.5, "offset": -0.3}}
    card.write_text(yaml.safe_dump({"name": "a", "trained": datetime.date(2026, 11, 30), "scores": scores}))
    asked = {"id": "a", "model": "a.onnx", "card": "a.card.yaml", "scores": "card"}
    (found,) = evaluation(small_mission, tmp_path, detectors=[asked]).detectors
    assert (found.score_threshold, found.calibration) == (0.41, Calibration(scale=1.5, offset=-0.3))
    card.write_text(yaml.safe_dump({"scores": scores | {"calibration": None}}))
    (found,) = evaluation(small_mission, tmp_path, detectors=[asked]).detectors
    assert (found.score_threshold, found.calibration) == (0.41, None)
    card.write_text("name: a")
    with pytest.raises(InputError, match=r"a\.card\.yaml.*scores"):
        evaluation(small_mission, tmp_path, detectors=[asked])


def test_odd_settings_are_refused_with_file_and_field(small_mission, tmp_path):
    for changes, message in (
        ({"pool": {"codec": "av1"}}, "pool.codec: found av1; expected one of transcoding.codecs: h264, vp9"),
        ({"detectors": [{"id": "a", "model": "x"}] * 2}, "detectors.1: found detector 'a' again"),
        ({"sample_rate": 2}, "sample_rate: found 2"),
        ({"score_cutoff": 1.5}, "score_cutoff: found 1.5"),
        (
            {"detectors": [{"id": "a", "model": "x", "calibration": {"scale": 1, "offset": 0}}]},
            "detectors.0.calibration: found calibration alone",
        ),
        ({"detectors": [{"id": "a", "model": "x", "scores": "card"}]}, "detectors.0.card: found no card"),
        (
            {"detectors": [{"id": "a", "model": "x", "card": "y", "scores": "card", "score_threshold": 0.3}]},
            "detectors.0.score_threshold: found a threshold beside the card's",
        ),
        ({"timing": {"setups": [{"machine": "m", "threads": 2, "clock": "processor"}]}}, "setups.0.clock"),
        ({"faults": {"outside_box": "maybe"}}, "faults.outside_box: found 'maybe'"),
        ({"tests": 1}, "tests: found an unknown key"),
    ):
        with pytest.raises(InputError) as raised:
            evaluation(small_mission, tmp_path, **changes)
        assert message in str(raised.value)
        assert "evaluation.yaml:" in str(raised.value)
