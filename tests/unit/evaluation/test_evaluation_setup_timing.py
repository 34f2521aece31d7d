from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.config.evaluation import Setup
from pipeline.evaluation.measuring.setup_timing import time_setup

NANO = Path(__file__).parents[3] / "configs/detectors/nano.onnx"


def measure(model, **changes):
    rng = np.random.default_rng(1)
    images = [rng.integers(0, 255, (288, 512, 3), dtype=np.uint8) for _ in range(2)]
    asked = {"pictures": 10, "warm_up": 2, "sharing": (), "score_cutoff": 0.3} | changes
    return time_setup("nano", model, Setup(machine="m"), images, progress=lambda _: None, **asked)


def test_times_are_ordered_memory_is_that_of_a_network_and_sharing_never_speeds_up():
    timing = measure(NANO, sharing=(2,))
    assert 0.0 < timing.minimum_s <= timing.mean_s <= timing.maximum_s
    assert timing.minimum_s <= timing.p95_s <= timing.maximum_s
    assert 2e6 < timing.memory_bytes < 500e6
    assert timing.sharing[2] >= 1.0
    assert 0.0 <= timing.busy <= 1.0
