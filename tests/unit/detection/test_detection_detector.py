from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.config.layout import Layout, Pairs, PictureInput
from pipeline.config.pool import Calibration
from pipeline.detection import Detector, NotFiniteError, load_detector
from pipeline.detection.preparation import Preparation
from pipeline.errors import InputError

NANO = Path(__file__).parents[3] / "configs" / "detectors" / "nano.onnx"


LAYOUT = Layout(
    input=PictureInput(
        tensor="image", axes="nhwc", range=255.0, placement="letterbox_top_left", filter="area"
    ),
    output=Pairs(boxes="boxes", scores="scores"),
    nms_iou=0.5,
)
PREPARATION = Preparation(LAYOUT.input, (), (), (512, 288), "uint8")


def detector_of(session, score_threshold, calibration=None):
    return Detector(session, LAYOUT, PREPARATION, {0: (0,)}, score_threshold, calibration)


class FakeSession:
    """Answers with fixed boxes in pixels of an input of 512 x 288."""

    def run(self, inputs):
        assert inputs["image"].shape == (1, 288, 512, 3)
        boxes = [[10, 10, 30, 60], [11, 10, 31, 60], [200, 100, 600, 400], [0, 0, 5, 5]]
        scores = [[0.8, 0.9, 0.5, 0.1]]
        return {"boxes": np.array([boxes], np.float32), "scores": np.array(scores, np.float32)}


def test_detections_are_suppressed_scaled_back_and_kept_inside_the_picture():
    detector = detector_of(FakeSession(), 0.3)
    boxes, scores, classes = detector.detect(np.zeros((576, 1024, 3), np.uint8))
    np.testing.assert_allclose(boxes, [[22, 20, 62, 120], [400, 200, 1024, 576]])
    np.testing.assert_allclose(scores, [0.9, 0.5], rtol=1e-6)
    assert (boxes.dtype, scores.dtype, classes.dtype) == (np.float64, np.float64, np.int64)


def test_nothing_found_has_the_shapes_of_no_boxes():
    detector = detector_of(FakeSession(), 0.95)
    boxes, scores, classes = detector.detect(np.zeros((576, 1024, 3), np.uint8))
    assert (boxes.shape, scores.shape, classes.shape) == ((0, 4), (0,), (0,))


def test_scores_are_calibrated_after_the_threshold_and_boxes_stay_as_they_are():
    image = np.zeros((576, 1024, 3), np.uint8)
    plain = detector_of(FakeSession(), 0.3).detect(image)
    calibration = Calibration(scale=2.0, offset=0.0)
    boxes, scores, _ = detector_of(FakeSession(), 0.3, calibration).detect(image)
    np.testing.assert_array_equal(boxes, plain[0])
    np.testing.assert_allclose(scores, [0.81 / 0.82, 0.5], rtol=1e-5)  # odds of 0.9 are 9, squared 81


@pytest.mark.parametrize(("part", "place"), [("scores", (0, 0)), ("boxes", (0, 0, 2))])
def test_a_network_that_says_nan_has_not_seen_the_picture(part, place):
    session = FakeSession()
    outputs = session.run({"image": np.zeros((1, 288, 512, 3))})
    outputs[part][place] = np.nan
    session.run = lambda _: outputs
    with pytest.raises(NotFiniteError):
        detector_of(session, 0.3).detect(np.zeros((576, 1024, 3), np.uint8))


def test_a_box_that_would_not_be_reported_may_be_nan():
    session = FakeSession()
    outputs = session.run({"image": np.zeros((1, 288, 512, 3))})
    outputs["boxes"][0, 3] = np.inf
    session.run = lambda _: outputs
    boxes, _, _ = detector_of(session, 0.3).detect(np.zeros((9, 16, 3), np.uint8))
    assert len(boxes) == 2


@pytest.mark.parametrize("content", [b"", b"this is text, not a network", b"\x08\x07\x12\x04" * 100])
def test_a_file_that_is_not_onnx_is_named_in_one_line(tmp_path, content):
    path = tmp_path / "detector.onnx"
    path.write_bytes(content)
    with pytest.raises(InputError) as error:
        load_detector(path, score_threshold=0.3)
    assert str(path) in str(error.value)
    assert "ONNX" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nobody\.onnx.*no file"):
        load_detector(tmp_path / "nobody.onnx", score_threshold=0.3)


def test_an_unknown_layout_is_asked_about_with_the_section_to_fill_in(tmp_path):
    onnx = pytest.importorskip("onnx", reason="onnx is not installed")
    value = [
        onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [1, 3, 64, 64]) for name in "xy"
    ]
    graph = onnx.helper.make_graph([onnx.helper.make_node("Relu", ["x"], ["y"])], "g", value[:1], value[1:])
    path = tmp_path / "relu.onnx"
    onnx.save(
        onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8), path
    )
    with pytest.raises(InputError, match=r"relu\.onnx.*no known layout.*layouts") as error:
        load_detector(path, score_threshold=0.3)
    assert "\n" not in str(error.value)
    assert "tensor: x" in error.value.details
    assert "colour: '?'" in error.value.details


@pytest.mark.skipif(not NANO.is_file(), reason="no shipped nano.onnx")
def test_a_provider_that_is_not_installed_is_refused():
    with pytest.raises(InputError, match="provider 'abacus'"):
        load_detector(NANO, score_threshold=0.3, provider="abacus")


@pytest.mark.skipif(not NANO.is_file(), reason="no shipped nano.onnx")
def test_the_same_picture_gives_the_same_boxes_bit_for_bit():
    image = np.random.default_rng(0).integers(0, 256, (576, 1024, 3), dtype=np.uint8)
    results = [load_detector(NANO, score_threshold=0.0).detect(image) for _ in range(2)]
    for a, b in zip(*results, strict=True):
        assert a.tobytes() == b.tobytes()
