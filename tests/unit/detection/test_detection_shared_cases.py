"""Signatures of common exports, and models that break our own contract, made by others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.detection import LayoutQuestionError, load_detector
from pipeline.errors import InputError

CASES = Path(__file__).parents[4] / "shared" / "data" / "cases" / "detectors"
pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason=f"{CASES} is not there")
SIGNATURES = {
    "damoyolo": "damoyolo or yolo_nas",
    "nanodet_plus": "nanodet_plus",
    "picodet_post": "picodet_with_nms or ppyoloe_with_nms",
    "rfdetr": None,
    "rtdetr_dynamic_hw": "rtdetr_with_sizes",
    "rtdetr_hf": "no known layout",
    "tf_ssd_mobilenet": "tf_ssd",
    "torchvision": "torchvision",
    "trt_end2end_nms": "tensorrt_nms",
    "yolov10n": None,
    "yolov5n_640": None,
    "yolov6n_640": "yolox or yolox_decoded or yolov6",
    "yolov8_1class": None,
    "yolov8_visdrone": None,
    "yolov8n_dynamic": "no known layout",
}


def opened(name, **how):
    return load_detector(CASES / f"{name}.onnx", score_threshold=0.3, **how)


@pytest.mark.parametrize("name", SIGNATURES)
def test_a_signature_without_weights_is_recognised_or_asked_about_with_the_section_filled_in(name):
    asked = SIGNATURES[name]
    if asked is None:
        assert opened(f"sig_{name}").recognised.name in name
        return
    with pytest.raises(LayoutQuestionError, match=asked) as question:
        opened(f"sig_{name}")
    assert "\n" not in str(question.value)
    assert question.value.details.count("input:") == 1
    assert "output:" in question.value.details


def test_a_yolo_world_that_needs_its_texts_is_refused():
    with pytest.raises(InputError, match="texts folded in"):
        opened("sig_yoloworld")


@pytest.mark.parametrize(
    ("name", "rule"),
    [
        ("dynamic", "fixed height and width"),
        ("float_input", "an input of uint8"),
        ("nchw", "height, width, 3"),
        ("scores_81", r"scores \(1, N\) second"),
        ("swapped_outputs", r"boxes \(1, N, 4\) first"),
        ("three_outputs", "two outputs"),
    ],
)
def test_a_model_that_says_it_is_ours_and_is_not_is_refused_with_the_rule(name, rule):
    with pytest.raises(InputError, match=rule):
        opened(f"own_{name}")


def test_the_name_of_our_input_does_not_matter():
    assert opened("own_named_input_images").detect(np.zeros((9, 9, 3), np.uint8))[0].shape == (0, 4)


@pytest.mark.parametrize("name", ["decoded", "raw", "fp16", "dynbatch"])
def test_yolox_decoded_or_not_finds_the_one_person(name):
    boxes, _, _ = opened(f"yolox_{name}").detect(np.zeros((64, 64, 3), np.uint8))
    np.testing.assert_allclose(boxes, [[24, 0, 48, 56]], atol=0.2)


def test_ten_classes_without_names_are_asked_about_and_used_with_names():
    with pytest.raises(LayoutQuestionError, match="10 classes without names"):
        opened("yolox_10cls")
    detector = opened("yolox_10cls", names=("person", *(f"thing {k}" for k in range(9))))
    np.testing.assert_allclose(
        detector.detect(np.zeros((64, 64, 3), np.uint8))[0], [[24, 0, 48, 56]], atol=0.2
    )
