"""Each layout by a small network with planted weights: recognised or asked about, and its box is right."""

from __future__ import annotations

import numpy as np
import planted
import pytest
import yaml
from planted import MEAN, MEAN_BGR, STD, STD_BGR, Net, spot

from pipeline.config.layout import Layout
from pipeline.detection import LayoutQuestionError, load_detector
from pipeline.detection.layout_section import layout_yaml

NAMES = ("cow", "person", "boat")
FOUR = (8, 16, 32, 64)
#: layout -> exporter, what the network takes, rivals that fit as well (empty: it is recognised)
CASES = {
    "yolov8": (planted.yolov8, {}, ()),
    "yolov5": (planted.yolov5, {}, ()),
    "yolov6": (planted.yolov6, {}, ()),
    "yolox": (planted.yolox, {"bgr": True, "range": 255.0}, ()),
    "yolox_decoded": (planted.yolox_decoded, {"bgr": True, "range": 255.0}, ()),
    "yolox_old_input": (planted.yolox, {"mean": MEAN, "std": STD}, ("yolox",)),
    "yolov10": (planted.yolov10, {}, ()),
    "yolov7_end2end": (planted.yolov7_end2end, {}, ()),
    "rtdetr_ultralytics": (planted.rtdetr_ultralytics, {}, ()),
    "tensorrt_nms": (planted.tensorrt_nms, {}, ()),
    "onnx_nms": (planted.onnx_nms, {}, ("onnx_nms_xyxy", "onnx_nms_yxyx")),
    "mmdetection": (
        planted.mmdetection,
        {"range": 255.0, "mean": MEAN_BGR[::-1], "std": STD_BGR[::-1]},
        ("mmdetection_rtmdet",),
    ),
    "nanodet": (planted.nanodet, {"bgr": True, "range": 255.0, "mean": MEAN_BGR, "std": STD_BGR}, ()),
    "nanodet_plus": (
        planted.nanodet_plus,
        {"bgr": True, "range": 255.0, "mean": MEAN_BGR, "std": STD_BGR, "strides": FOUR},
        (),
    ),
    "picodet": (planted.nanodet, {"mean": MEAN, "std": STD, "strides": FOUR}, ()),
    "picodet_with_nms": (planted.picodet_with_nms, {"mean": MEAN, "std": STD}, ("ppyoloe_with_nms",)),
    "fastestdet": (planted.fastestdet, {"bgr": True, "strides": (16,)}, ()),
    "yolo_fastestv2": (planted.yolo_fastestv2, {"bgr": True, "strides": (16, 32)}, ()),
    "damoyolo": (planted.damo, {"range": 255.0}, ("yolo_nas",)),
    "yolo_nas": (planted.damo, {}, ("damoyolo",)),
    "rtdetr": (planted.rtdetr, {"strides": (8,)}, ("rfdetr",)),
    "rfdetr": (planted.rtdetr, {"mean": MEAN, "std": STD, "strides": (8,)}, ("rtdetr",)),
    "rtdetr_with_sizes": (planted.rtdetr_with_sizes, {}, ()),
    "tf_ssd": (planted.tf_ssd, {"axes": "nhwc", "dtype": "uint8", "range": 255.0}, ()),
    "torchvision": (planted.torchvision, {"axes": "chw"}, ()),
}


def made(name, tmp_path, external=False, **how):
    """The file of a network, and the picture with the person's box."""
    export, takes, _ = CASES[name]
    net = Net(**{**takes, **how})
    export(net)
    return net.save(tmp_path / f"{name}.onnx", external), net


def opened(path, name=None, **how):
    how = {"names": NAMES, "layout": name} | how
    return load_detector(path, score_threshold=0.3, **how)


def sees_the_person(detector, net, stride=8):
    """Whether it finds the red cell, there and nowhere else."""
    image, box = spot(net)
    if stride == 16:  # a cell of stride 16 is red
        image[:] = 90
        image[64:96, 96:128] = [255, 0, 0]
        box = [112 - 24, 80 - 40, 112 + 24, 80 + 40]
    boxes, scores, classes = detector.detect(image)
    assert len(boxes) == 1, (boxes, scores)
    np.testing.assert_allclose(boxes[0], box, atol=1.0)
    assert scores[0] > 0.5
    assert classes.tolist() == [0]


def stride_of(name):
    return 16 if name in ("fastestdet", "yolo_fastestv2") else 8


@pytest.mark.parametrize("name", CASES)
def test_a_network_of_a_layout_is_recognised_or_asked_about_and_its_box_is_right(name, tmp_path):
    path, net = made(name, tmp_path)
    rivals = CASES[name][2]
    if rivals and name != "yolox_old_input":
        with pytest.raises(LayoutQuestionError) as question:
            opened(path)
        assert name in str(question.value)
        assert all(rival in str(question.value) for rival in rivals)
        assert "layout:" in question.value.details
    elif not rivals:
        assert opened(path).recognised.name == name
    sees_the_person(opened(path, name if rivals else None), net, stride_of(name))


@pytest.mark.parametrize("name", CASES)
def test_a_layout_described_in_yaml_gives_the_boxes_of_the_built_in(name, tmp_path):
    path, net = made(name, tmp_path)
    built_in = opened(path, name)
    described = Layout.model_validate(yaml.safe_load(layout_yaml(built_in.layout))["layout"])
    again = opened(path, described)
    image, _ = spot(net)
    for a, b in zip(built_in.detect(image), again.detect(image), strict=True):
        np.testing.assert_array_equal(a, b)
    sees_the_person(again, net, stride_of(name))


#: their graphs resize: they take a picture as it comes
RESIZING = ("tf_ssd", "torchvision")


@pytest.mark.parametrize("name", [name for name in CASES if not CASES[name][2] and name not in RESIZING])
def test_a_free_batch_axis_and_free_sizes_are_no_hindrance(name, tmp_path):
    path, net = made(name, tmp_path, free=True)
    net.metadata["imgsz"] = [planted.HEIGHT, planted.WIDTH]
    net.save(path)
    sees_the_person(opened(path), net, stride_of(name))


@pytest.mark.parametrize("name", RESIZING)
def test_free_sizes_of_a_network_that_resizes_take_the_picture_as_it_comes(name, tmp_path):
    path, net = made(name, tmp_path, free=True)
    net.save(path)
    detector = opened(path)
    assert detector.layout.input.size == "picture"
    twice, box = spot(net)
    boxes, scores, _ = detector.detect(np.ascontiguousarray(twice[::2, ::2]))  # the size of the planted cells
    assert len(boxes) == 1
    assert scores[0] > 0.5
    np.testing.assert_allclose(boxes[0], np.array(box) / 2, atol=1.0)


@pytest.mark.parametrize("name", ["yolov8", "yolox", "nanodet", "rtdetr_with_sizes"])
@pytest.mark.parametrize("dtype", ["float16", "uint8"])
def test_other_types_of_input_are_used(name, dtype, tmp_path):
    how = {"dtype": dtype}
    if dtype == "uint8":
        how |= {"range": 255.0, "mean": planted.ZERO, "std": planted.ONE}
    path, net = made(name, tmp_path, **how)
    sees_the_person(opened(path), net)


@pytest.mark.parametrize("name", ["yolov8", "yolov5", "yolox"])
def test_pictures_in_rows_and_columns_are_used(name, tmp_path):
    path, net = made(name, tmp_path, axes="nhwc")
    sees_the_person(opened(path), net)


def test_external_data_is_read_and_its_lack_is_one_line(tmp_path):
    path, net = made("yolov8", tmp_path, external=True)
    sees_the_person(opened(path), net)
    (tmp_path / f"{path.name}.data").unlink()
    with pytest.raises(Exception, match=r"yolov8\.onnx.*expected") as error:
        opened(path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["yolov8", "yolov5", "yolox", "nanodet", "fastestdet"])
@pytest.mark.parametrize("classes", [1, 2, 10, 32, 79, 80, 81])
def test_another_number_of_classes_stays_right_or_becomes_a_question(name, classes, tmp_path):
    path, net = made(name, tmp_path, classes=classes, person=0)
    if classes not in (1, 80):
        with pytest.raises(LayoutQuestionError, match="names"):
            opened(path, names=None)
    names = ("person", *(f"thing {k}" for k in range(1, classes)))
    sees_the_person(opened(path, names=names), net, stride_of(name))


def test_a_picture_of_another_aspect_is_letterboxed_where_the_layout_says_so(tmp_path):
    for name, top in (("yolov8", 16), ("yolox", 0)):
        path, _ = made(name, tmp_path)
        image = np.full((192, 384, 3), 90, np.uint8)  # in an input of 192 x 128: half size, 96 rows of it
        image[32:48, 80:96] = [255, 0, 0]
        boxes, _, _ = opened(path).detect(image)
        assert top % 8 == 0
        np.testing.assert_allclose(boxes, [[88 - 24, 40 - 40, 88 + 24, 40 + 40]], atol=1.0)


def test_a_turned_yolov8_is_told_from_yolox_by_its_names(tmp_path):
    net = Net(classes=3, person=1)
    planted.yolov8_turned(net)
    path = net.save(tmp_path / "turned.onnx")
    found = opened(path)
    assert found.recognised.name == "yolov8"
    sees_the_person(found, net)


@pytest.mark.parametrize("task", ["obb", "segment", "pose", "classify"])
def test_models_that_do_something_else_say_so(task, tmp_path):
    path, net = made("yolov8", tmp_path)
    net.metadata["task"] = task
    net.save(path)
    with pytest.raises(Exception, match=f"{task}.*detect"):
        opened(path)


def test_names_come_from_metadata_and_classes_from_the_pool(tmp_path):
    path, net = made("yolov8", tmp_path)
    net.metadata["names"] = {0: "car", 1: "pedestrian", 2: "boat"}
    net.save(path)
    image, _ = spot(net)
    layers = {"person": 0, "boat": 7}
    assert opened(path, names=None, layers=layers).detect(image)[2].tolist() == [0]
    swapped = opened(
        path, names=None, layers=layers, classes={"boat": ["pedestrian", "boat"], "person": ["car"]}
    )
    assert swapped.detect(image)[2].tolist() == [7]
    with pytest.raises(Exception, match="'ship'; expected one of car, pedestrian, boat"):
        opened(path, names=None, classes={"person": ["ship"]})


def test_a_network_without_persons_is_refused(tmp_path):
    path, _ = made("yolov8", tmp_path)
    with pytest.raises(Exception, match="knows cow, horse, boat; expected one that knows person"):
        opened(path, names=("cow", "horse", "boat"))


def test_one_box_overlapping_another_class_stays(tmp_path):
    """A person in a boat is both."""
    path, net = made("yolov8", tmp_path)
    detector = opened(
        path, layers={"person": 0, "boat": 7}, classes={"person": ["person"], "boat": ["person"]}
    )
    assert detector.detect(spot(net)[0])[2].tolist() == [0, 7]


def test_a_user_s_package_can_add_a_layout(tmp_path, monkeypatch):
    """It comes as an entry point, and is asked beside the built-in ones."""
    from types import SimpleNamespace

    from pipeline.config.layout import Rows
    from pipeline.detection import layouts
    from pipeline.detection.layouts.proposal import Proposal, picture_input

    def propose(facts):
        (output,) = facts.outputs
        if output.shape != (384, 8):
            return []
        layout = Layout(
            input=picture_input(facts, colour="bgr", placement="stretched"),
            output=Rows(tensor=output.name, box="xyxy", objectness=True),
            nms_iou=0.5,
        )
        return [Proposal("mine", layout, ("it is mine",), 3)]

    net = Net(bgr=True, strides=(8,))
    planted._objectness(net, net.boxes("xyxy"))
    path = net.save(tmp_path / "mine.onnx")
    with pytest.raises(LayoutQuestionError):
        opened(path)
    mine = SimpleNamespace(load=lambda: SimpleNamespace(name="mine", propose=propose))
    asked = []
    monkeypatch.setattr(layouts, "entry_points", lambda group: asked.append(group) or [mine])
    detector = opened(path)
    assert asked[0] == "searchlight.detector_layouts"
    assert detector.recognised.name == "mine"
    sees_the_person(detector, net)
