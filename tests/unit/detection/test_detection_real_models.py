"""Models that other projects trained: the adapters must find the people that their own code finds."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import pytest

from pipeline.detection import load_detector

DATA = Path(__file__).parents[4] / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not there")


@pytest.fixture(scope="module")
def four_people():
    with av.open(str(DATA / "images" / "four_people.jpg")) as container:
        return next(container.decode(video=0)).to_ndarray(format="rgb24")


@pytest.mark.parametrize(
    ("file", "layout", "score_threshold", "people"),
    [
        ("fastestdet.onnx", "fastestdet", 0.5, 6),
        ("nanodet_m_320.onnx", "nanodet", 0.35, 3),
        ("yolox_nano_416.onnx", "yolox", 0.35, 4),
        ("light_person_192.onnx", "yolox", 0.35, 4),
        ("deimv2_atto_320_int8.onnx", "rtdetr_with_sizes", 0.35, 3),
    ],
)
def test_a_published_model_finds_as_many_people_as_published(
    four_people, file, layout, score_threshold, people
):
    detector = load_detector(DATA / "detectors" / file, score_threshold=score_threshold)
    boxes, scores, classes = detector.detect(four_people)
    assert detector.recognised.name == layout
    assert boxes.shape == (people, 4)
    assert (np.diff(scores) <= 0).all()
    assert scores.min() >= score_threshold
    assert (classes == 0).all()
    assert (boxes[:, :2] < boxes[:, 2:]).all()


@pytest.mark.parametrize(
    "file", ["fastestdet.onnx", "nanodet_m_320.onnx", "yolox_nano_416.onnx", "light_person_192.onnx"]
)
def test_models_agree_on_where_the_man_on_the_left_stands(four_people, file):
    detector = load_detector(DATA / "detectors" / file, score_threshold=0.35)
    boxes, _, _ = detector.detect(four_people)
    nearest = np.abs(boxes - [41.0, 62.0, 186.0, 298.0]).max(axis=1).min()
    assert nearest < 12.0
