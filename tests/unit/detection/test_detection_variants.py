"""Other names of tensors, another number of classes, other heads: right, or asked about, or refused; never misread."""

from __future__ import annotations

import random

import numpy as np
import onnx
import pytest
from planted import HEIGHT, WIDTH, Net, spot
from test_detection_planted_layouts import CASES, made, sees_the_person, stride_of

from pipeline.detection import LayoutQuestionError, load_detector
from pipeline.errors import InputError

#: taken for the newer input where the trial picture tells nothing, and that is said
ASSUMED = ("yolox_old_input",)


def renamed(path, seed):
    """Inputs and outputs with names that mean nothing, in another order."""
    model, rng = onnx.load(path), random.Random(seed)
    graph = model.graph
    names = {v.name: f"z{rng.randrange(1 << 32):08x}" for v in (*graph.input, *graph.output)}
    for node in graph.node:
        node.input[:] = [names.get(name, name) for name in node.input]
        node.output[:] = [names.get(name, name) for name in node.output]
    for value in (*graph.input, *graph.output):
        value.name = names[value.name]
    outputs = list(graph.output)
    rng.shuffle(outputs)
    del graph.output[:]
    graph.output.extend(outputs)
    onnx.save(model, path)


def right_or_asked(name, tmp_path, classes, person):
    path, net = made(name, tmp_path, classes=classes, person=person)
    renamed(path, classes)
    names = tuple("person" if k == person else f"thing {k}" for k in range(classes))
    try:
        detector = load_detector(path, score_threshold=0.3, names=names)
    except LayoutQuestionError:
        return
    sees_the_person(detector, net, stride_of(name))


@pytest.mark.parametrize(("classes", "person"), [(80, 0), (91, 1)])
@pytest.mark.parametrize("name", [name for name in CASES if name not in ASSUMED])
def test_neither_names_of_tensors_nor_cocos_numbers_of_classes_decide(name, classes, person, tmp_path):
    right_or_asked(name, tmp_path, classes, person)


@pytest.mark.slow
@pytest.mark.parametrize(("classes", "person"), [(1, 0), (2, 1), (4, 0), (10, 9), (32, 5), (85, 3), (112, 7)])
@pytest.mark.parametrize("name", [name for name in CASES if name not in ASSUMED])
def test_no_number_of_classes_makes_a_layout_misread(name, classes, person, tmp_path):
    right_or_asked(name, tmp_path, classes, person)


def test_what_only_the_age_of_a_yolox_decides_is_assumed_and_said(tmp_path):
    path, _ = made("yolox_old_input", tmp_path)
    found = load_detector(path, score_threshold=0.3, names=("cow", "person", "boat")).recognised
    assert found.name == "yolox"
    assert "BGR in 0..255" in found.assumed[0]


def head(tmp_path, more, classes, *, turned=False, protos=False, names=None):
    """A YOLOv8 that gives more than boxes and classes. more: columns (M, N) of further values."""
    net = Net(classes=classes, person=0, metadata={} if names is None else {"names": dict(enumerate(names))})
    scores = net.class_scores(net.score(), columns=True)
    rows = net.op("Concat", net.const(net.boxes().T[None]), scores, net.const(more[None]), axis=1)
    shape = [1, 4 + classes + len(more), more.shape[1]]
    if turned:
        rows, shape = net.op("Transpose", rows, perm=[0, 2, 1]), [shape[0], shape[2], shape[1]]
    net.give(rows, "y", shape)
    if protos:
        net.give(net.const(np.ones((1, 32, HEIGHT // 4, WIDTH // 4))), "p", [1, 32, HEIGHT // 4, WIDTH // 4])
    return net.save(tmp_path / "head.onnx")


CELLS = len(Net().cells()[0])
RNG = np.random.default_rng(1)
HEADS = {
    "rotated boxes": RNG.uniform(-np.pi / 4, 3 * np.pi / 4, (1, CELLS)),
    "rotated boxes, all a little": RNG.uniform(0.1, 0.25, (1, CELLS)),
    "rotated boxes, half of them upright": RNG.uniform(0.0, 0.3, (1, CELLS)),
    "rotated boxes, all by nearly the same": np.clip(RNG.normal(0.3, 0.02, (1, CELLS)), 0, 0.45),
    "masks": RNG.normal(0, 0.6, (32, CELLS)),
    "masks of small weights": RNG.uniform(0.0, 0.2, (32, CELLS)),
    "poses": np.concatenate([RNG.uniform(0, (WIDTH, HEIGHT, 1), (CELLS, 3)).T for _ in range(17)]),
}


@pytest.mark.parametrize("classes", [1, 15, 80])
@pytest.mark.parametrize("how", ["silent", "names in the metadata", "names in the pool"])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("kind", HEADS)
def test_a_head_that_gives_more_than_boxes_is_not_read_as_one_that_does_not(
    kind, turned, how, classes, tmp_path
):
    """Without the exporter's ``task``; with it, it is refused by name."""
    names = ("person", *(f"thing {k}" for k in range(1, classes)))
    path = head(
        tmp_path, HEADS[kind], classes, turned=turned, names=names if how == "names in the metadata" else None
    )
    with pytest.raises(InputError) as refusal:
        load_detector(path, score_threshold=0.3, names=names if how == "names in the pool" else None)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("classes", [1, 15, 80])
def test_a_small_angle_that_looks_like_a_class_is_asked_about_and_used_if_that_is_the_answer(
    classes, tmp_path
):
    names = ("person", *(f"thing {k}" for k in range(1, classes)))
    path = head(tmp_path, HEADS["rotated boxes, all a little"], classes, turned=True)
    with pytest.raises(LayoutQuestionError, match=r"0\.1 to 0\.25 everywhere, as an angle") as question:
        load_detector(path, score_threshold=0.3, names=names)
    assert "layout: yolox_decoded" in str(question.value)
    assert "objectness: true" in question.value.details
    answered = load_detector(path, score_threshold=0.3, names=names, layout="yolox_decoded")
    assert answered.recognised.name == "yolox_decoded"


def test_masks_beside_the_boxes_are_named(tmp_path):
    path = head(tmp_path, HEADS["masks"], 80, protos=True)
    with pytest.raises(InputError, match="masks; expected a model that detects"):
        load_detector(path, score_threshold=0.3)


def test_the_names_of_rfdetrs_own_export_tell_it_from_rtdetr_and_nothing_else_does(tmp_path):
    def saved(boxes, scores):
        path, _ = made("rfdetr", tmp_path, classes=91, person=1)
        model = onnx.load(path)
        for node in model.graph.node:
            node.output[:] = [{"b": boxes, "a": scores}.get(name, name) for name in node.output]
        for value in model.graph.output:
            value.name = {"b": boxes, "a": scores}[value.name]
        onnx.save(model, path)
        return path

    detector = load_detector(saved("dets", "labels"), score_threshold=0.3)
    assert detector.recognised.name == "rfdetr"
    assert len(detector.detect(spot(Net(mean=np.zeros(3)))[0])[0]) == 1
    for names in (("x", "y"), ("pred_boxes", "logits"), ("labels", "dets")):
        with pytest.raises(LayoutQuestionError, match="rtdetr or rfdetr"):
            load_detector(saved(*names), score_threshold=0.3)
