"""Each layout against a prediction that was put into its outputs by hand."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.detection.layouts import recognise
from pipeline.detection.session import Signature

CASES = {
    "searchlight": Signature(
        {"image": (1, 288, 512, 3)},
        {"boxes": (1, 2304, 4), "scores": (1, 2304)},
        {"layout": "searchlight"},
    ),
    "fastestdet": Signature({"in": (1, 3, 352, 352)}, {"out": (1, 85, 22, 22)}),
    "nanodet": Signature(
        {"in": (1, 3, 320, 320)},
        {f"c{n}": (1, n, 80) for n in (1600, 400, 100)} | {f"d{n}": (1, n, 32) for n in (1600, 400, 100)},
    ),
    "yolox": Signature({"in": (1, 3, 416, 416)}, {"out": (1, 3549, 85)}),
    "light_person": Signature({"in": (1, 3, 192, 192)}, {"out": (1, 756, 6)}),
    "deim": Signature(
        {"images": ("batch", 3, 320, 320), "orig_target_sizes": ("batch", 2)},
        {"labels": ("n",), "boxes": ("n", 4), "scores": ("n",)},
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_layout_is_recognised_by_its_signature(name):
    layout = recognise(CASES[name])
    assert layout is not None
    assert layout.name == name


@pytest.mark.parametrize(
    "signature",
    [
        Signature({"in": (1, 3, 224, 224)}, {"out": (1, 1000)}),
        Signature({"in": (1, 3, 416, 416)}, {"out": (1, 3549, 84)}),
        Signature({"in": ("batch", 3, "height", "width")}, {"out": (1, 3549, 85)}),
        Signature({"image": (1, 288, 512, 3)}, {"boxes": (1, 2304, 4), "scores": (1, 2304)}),
        Signature({}, {}),
    ],
)
def test_other_signatures_are_nobodys(signature):
    assert recognise(signature) is None


@pytest.mark.parametrize("name", CASES)
def test_a_prepared_picture_has_the_shape_that_the_model_takes(name):
    signature = CASES[name]
    layout = recognise(signature)
    assert layout is not None
    inputs, _ = layout.prepare(np.full((180, 320, 3), 77, np.uint8))
    assert inputs.keys() == signature.inputs.keys()
    for key, shape in signature.inputs.items():
        assert inputs[key].shape == tuple(1 if size == "batch" else size for size in shape)


def decoded(name: str, outputs: list[np.ndarray]):
    """The box with the highest score, and that score."""
    layout = recognise(CASES[name])
    assert layout is not None
    boxes, scores = layout.decode(outputs)
    return boxes[scores.argmax()], scores.max()


def test_fastestdet_decodes_tanh_offsets_and_shares_of_the_picture():
    out = np.zeros((1, 85, 22, 22), np.float32)
    out[0, :6, 7, 4] = [0.9, np.arctanh(0.5), np.arctanh(-0.25), 0.0, -np.log(3.0), 0.8]
    box, score = decoded("fastestdet", [out])
    x, y, w, h = (4 + 0.5) * 16, (7 - 0.25) * 16, 0.5 * 352, 0.25 * 352
    np.testing.assert_allclose(box, [x - w / 2, y - h / 2, x + w / 2, y + h / 2], rtol=1e-6)
    assert score == pytest.approx(0.9**0.6 * 0.8**0.4)


@pytest.mark.parametrize(
    ("name", "cells", "columns", "edge"), [("yolox", 3549, 85, 416), ("light_person", 756, 6, 192)]
)
def test_yolox_decodes_offsets_and_log_sizes_on_its_coarsest_grid(name, cells, columns, edge):
    out = np.zeros((1, cells, columns), np.float32)
    side = edge // 32
    cell = cells - side * side + 2 * side + 3  # row 2, column 3 of the last grid
    out[0, cell, :6] = [0.5, 0.25, np.log(2.0), np.log(3.0), 0.9, 0.5]
    box, score = decoded(name, [out])
    x, y, w, h = 3.5 * 32, 2.25 * 32, 64, 96
    np.testing.assert_allclose(box, [x - w / 2, y - h / 2, x + w / 2, y + h / 2], rtol=1e-6)
    assert score == pytest.approx(0.45)


def test_nanodet_decodes_the_mean_of_its_distributions():
    scores = [np.zeros((1, n, 80), np.float32) for n in (1600, 400, 100)]
    bins = [np.zeros((1, n, 32), np.float32) for n in (1600, 400, 100)]
    scores[1][0, 3 * 20 + 5, 0] = 0.7
    bins[1][0, 3 * 20 + 5].reshape(4, 8)[np.arange(4), [1, 2, 3, 4]] = 50.0
    box, score = decoded("nanodet", scores + bins)
    x, y = 5.5 * 16, 3.5 * 16
    np.testing.assert_allclose(box, [x - 16, y - 32, x + 48, y + 64], rtol=1e-6)
    assert score == pytest.approx(0.7)


def test_deim_reports_only_people():
    labels = np.array([17, 0, 2])
    boxes = np.array([[0, 0, 1, 1], [1, 2, 3, 4], [5, 5, 9, 9]], np.float32)
    layout = recognise(CASES["deim"])
    assert layout is not None
    found, scores = layout.decode([labels, boxes, np.array([0.9, 0.6, 0.8], np.float32)])
    np.testing.assert_array_equal(found, [[1, 2, 3, 4]])
    np.testing.assert_allclose(scores, [0.6], rtol=1e-6)


def test_bgr_models_get_blue_first():
    blue = np.zeros((416, 416, 3), np.uint8)
    blue[..., 2] = 255
    layout = recognise(CASES["yolox"])
    assert layout is not None
    inputs, _ = layout.prepare(blue)
    np.testing.assert_array_equal(inputs["in"][0].max(axis=(1, 2)), [255, 0, 0])
