"""The pool file that is written from measurements."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("faster_coco_eval", reason="the extra [train] is not installed")

import yaml

from pipeline.config.pool import load_pool
from pipeline.training.measure_pool import Measured, pool_of
from pipeline.training.timing import Timing, time_detector


@pytest.fixture
def pool(tmp_path):
    models = {"nano": tmp_path / "detectors" / "nano.onnx"}
    measured = {"nano": Measured({250e3: 0.5, 1e6: 0.75}, 0.47, Timing(0.005, 0.004, 0.0061), 40_000_000)}
    path = tmp_path / "pools" / "demo.yaml"
    path.parent.mkdir()
    path.write_text(yaml.safe_dump(pool_of(models, measured, path.parent), sort_keys=False))
    return load_pool(path)


def test_the_pool_holds_what_was_measured(pool):
    (detector,) = pool.detectors
    assert [(point.bitrate, point.accuracy) for point in detector.accuracy] == [(250e3, 0.5), (1e6, 0.75)]
    assert detector.memory == 50e6
    assert detector.score_threshold == 0.47
    workstation = detector.times[0]
    assert workstation.machine == "workstation"
    assert (workstation.mean, workstation.maximum) == pytest.approx((0.005, 0.0061))


def test_what_was_not_measured_is_said_to_be_assumed(pool):
    onboard = pool.detectors[0].times[1]
    assert onboard.mean == pytest.approx(6 * 0.005)
    assert any("onboard" in text for text in pool.assumed)


def test_model_and_card_are_found_from_the_pool_file(pool, tmp_path):
    (detector,) = pool.detectors
    assert detector.model.resolve() == tmp_path / "detectors" / "nano.onnx"
    assert detector.card.resolve() == tmp_path / "detectors" / "nano.card.yaml"


def test_timing_orders_its_statistics():
    class Detector:
        def detect(self, image):
            return np.sort(image.ravel())

    timing = time_detector(Detector(), np.zeros((32, 32, 3), np.uint8), 20)
    assert 0.0 < timing.median_s <= timing.p99_s
    assert timing.mean_s <= timing.p99_s
