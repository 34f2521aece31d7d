from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.config.evaluation import EvaluatedDetector
from pipeline.detection import load_detector
from pipeline.errors import InputError
from pipeline.evaluation.measuring.precision import in_precision

NANO = Path(__file__).parents[3] / "configs/detectors/nano.onnx"


def detector(precision, model=NANO):
    return EvaluatedDetector(id="nano", model=model, precision=precision)


def test_as_exported_is_the_file_itself(tmp_path):
    assert in_precision(detector("as_exported"), tmp_path) == NANO
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("precision", "at_most"), [("float16", 0.6), ("int8", 0.5)])
def test_a_converted_model_is_smaller_and_scores_alike(tmp_path, precision, at_most):
    pytest.importorskip("onnx", reason="the extra [train] is not installed")
    model = in_precision(detector(precision), tmp_path)
    assert model.stat().st_size < at_most * NANO.stat().st_size
    image = np.random.default_rng(1).integers(0, 255, (288, 512, 3), dtype=np.uint8)
    scores = [load_detector(m, score_threshold=0.0).candidates(image)[1] for m in (NANO, model)]
    assert np.abs(scores[0] - scores[1]).max() < 0.2
    assert np.abs(scores[0] - scores[1]).mean() < 0.01


def test_a_model_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="no file"):
        in_precision(detector("int8", tmp_path / "absent.onnx"), tmp_path)
