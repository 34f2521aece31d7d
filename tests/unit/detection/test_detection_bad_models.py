"""Models that cannot be used: one line each, and never the end of the process that checks them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper
from planted import Net, yolov8, yolox

from pipeline.detection import NotFiniteError, load_detector
from pipeline.detection import crash_test as crash_module
from pipeline.detection.crash_test import require_survivable, survived
from pipeline.detection.folding import folded
from pipeline.detection.graph import class_count
from pipeline.errors import InputError

NAMES = ("cow", "person", "boat")


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    net = Net()
    yolov8(net)
    return net.save(tmp_path_factory.mktemp("good") / "good.onnx")


@pytest.fixture(autouse=True)
def _own_memory(tmp_path, monkeypatch):
    """Nothing is known of any file from before."""
    monkeypatch.setattr(crash_module.tempfile, "tempdir", str(tmp_path))


def refused(path: Path, match: str, **how) -> None:
    with pytest.raises(InputError, match=match) as error:
        load_detector(path, score_threshold=0.3, **{"names": NAMES, **how})
    assert "\n" not in str(error.value)
    assert path.name in str(error.value)


def saved(tmp_path, nodes, inputs, outputs, weights=(), opset=13, domain=""):
    graph = helper.make_graph(nodes, "g", inputs, outputs, weights)
    opsets = [helper.make_opsetid("", opset)] + ([helper.make_opsetid(domain, 1)] if domain else [])
    path = tmp_path / "made.onnx"
    onnx.save(helper.make_model(graph, opset_imports=opsets, ir_version=8), path)
    return path


def value(name, shape, kind=TensorProto.FLOAT):
    return helper.make_tensor_value_info(name, kind, shape)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.99])
def test_a_truncated_file_is_one_line(good, tmp_path, share):
    path = tmp_path / "cut.onnx"
    path.write_bytes(good.read_bytes()[: int(share * good.stat().st_size)])
    refused(path, "not a usable ONNX model")


@pytest.mark.parametrize(
    "content", [b"PK\x03\x04weights", b"\x89HDF\r\n", b"TFL3" * 50, b"{}", b"\x00" * 4096]
)
def test_a_file_of_another_kind_is_one_line(tmp_path, content):
    path = tmp_path / "foreign.onnx"
    path.write_bytes(content)
    refused(path, "ONNX")


def test_an_operator_that_onnx_runtime_lacks_is_named(tmp_path):
    node = helper.make_node("EfficientNMS_TRT", ["x"], ["y"], domain="TRT")
    path = saved(tmp_path, [node], [value("x", [1, 3, 64, 64])], [value("y", [1, 100, 6])], domain="TRT")
    refused(path, "EfficientNMS_TRT")


def test_a_model_that_fails_on_a_picture_is_refused_before_it_flies(tmp_path):
    nodes = [
        helper.make_node("Shape", ["x"], ["s"]),
        helper.make_node("Reshape", ["x", "to"], ["y"]),
    ]
    to = helper.make_tensor("to", TensorProto.INT64, [2], [7, 11])
    path = saved(tmp_path, nodes[1:], [value("x", ["b", 3, "h", "w"])], [value("y", [7, 11])], [to])
    refused(path, "fails on a picture")


@pytest.mark.parametrize(
    ("kind", "shape", "match"),
    [
        (TensorProto.INT64, [1, 3, 64, 64], "int64"),
        (TensorProto.STRING, [1, 3, 64, 64], "string"),
        (TensorProto.FLOAT, [1, 16000], "can be a picture"),
        (TensorProto.FLOAT, [1, 5, 64, 64], "can be a picture"),
    ],
)
def test_a_model_that_takes_no_picture_is_refused(tmp_path, kind, shape, match):
    path = saved(
        tmp_path,
        [helper.make_node("Identity", ["x"], ["y"])],
        [value("x", shape, kind)],
        [value("y", shape, kind)],
    )
    refused(path, match)


def test_a_classifier_is_asked_about_and_not_used(tmp_path):
    nodes = [
        helper.make_node("GlobalAveragePool", ["x"], ["p"]),
        helper.make_node("Flatten", ["p"], ["y"]),
    ]
    refused(saved(tmp_path, nodes, [value("x", [1, 3, 224, 224])], [value("y", [1, 3])]), "no known layout")


def test_a_model_that_says_nan_is_refused_at_the_check(tmp_path):
    net = Net()
    yolov8(net)
    net.nodes.append(helper.make_node("Mul", ["y", net.const([np.nan])], ["z"]))
    net.outputs = [value("z", [1, 7, None])]
    refused(net.save(tmp_path / "nan.onnx"), "NaN")


def test_a_detector_that_says_nan_later_says_so(good):
    detector = load_detector(good, score_threshold=0.3, names=NAMES)
    real = detector._session.run

    def spoiled(inputs):
        outputs = real(inputs)
        outputs["y"][:] = np.nan
        return outputs

    detector._session.run = spoiled
    with pytest.raises(NotFiniteError):
        detector.detect(np.zeros((64, 64, 3), np.uint8))


def test_a_child_that_is_killed_is_a_reason_and_the_others_are_still_looked_at(good, tmp_path, monkeypatch):
    other = tmp_path / "other.onnx"
    net = Net(bgr=True, range=255.0)
    yolox(net)
    net.save(other)
    program = (
        "import sys, os, signal\n"
        "for path in sys.argv[2:]:\n"
        "    if 'good' in path: os.kill(os.getpid(), signal.SIGSEGV)\n"
        "    print('fine', flush=True)\n"
    )
    run = crash_module.subprocess.run
    monkeypatch.setattr(
        crash_module.subprocess,
        "run",
        lambda command, **how: run([command[0], "-c", program, *command[2:]], **how),
    )
    found = survived([other, good, tmp_path / "missing.onnx"])
    assert found[other] is None
    assert found[tmp_path / "missing.onnx"] is None
    assert "SIGSEGV" in found[good]
    monkeypatch.setattr(crash_module.subprocess, "run", lambda *_, **__: pytest.fail("known by its hash"))
    with pytest.raises(InputError, match=r"good\.onnx: found a model that ends the process"):
        require_survivable(good)


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """A few bytes changed, cut out, doubled, or the end cut off."""
    out = bytearray(data)
    for _ in range(rng.integers(1, 6)):
        at, length = int(rng.integers(len(out))), int(rng.integers(1, 12))
        kind = rng.integers(5)
        if kind == 0:
            out[at] = int(rng.integers(256))
        elif kind == 1:
            out[at] ^= 1 << int(rng.integers(8))
        elif kind == 2 and len(out) > 64:
            del out[at : at + length]
        elif kind == 3:
            out[at:at] = out[at : at + length]
        elif rng.random() < 0.2:
            out = out[: max(at, 16)]
    return bytes(out)


def look_at_mutants(good: Path, folder: Path, count: int, seed: int) -> None:
    rng, data = np.random.default_rng(seed), good.read_bytes()
    paths = []
    for k in range(count):
        paths.append(folder / f"m{k}.onnx")
        paths[-1].write_bytes(mutated(data, rng))
    said: list[str] = []
    for path, reason in survived(paths).items():
        said.append(reason or "")
        if reason is None:
            try:
                load_detector(path, score_threshold=0.3, names=NAMES).detect(np.zeros((64, 96, 3), np.uint8))
            except (InputError, NotFiniteError) as error:
                said.append(str(error))
    assert not any("\n" in line for line in said)


def test_mutated_models_are_refused_or_used(good, tmp_path):
    look_at_mutants(good, tmp_path, 60, 1)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_two_thousand_mutated_models_end_no_process(good, tmp_path):
    for part in range(20):
        look_at_mutants(good, tmp_path, 100, 100 + part)


@pytest.mark.parametrize("nowhere", [np.nan, np.inf])
def test_a_model_whose_boxes_are_all_no_numbers_is_refused_even_if_it_finds_nothing(tmp_path, nowhere):
    net = Net()
    scores = net.class_scores(net.score(), columns=True)
    boxes = np.full((1, 4, len(net.boxes())), nowhere)
    net.give(net.op("Concat", net.const(boxes), scores, axis=1), "y", [1, 4 + net.classes, None])
    refused(net.save(tmp_path / "nowhere.onnx"), "504 of 504 boxes would be NaN or infinite")


def test_weights_that_are_listed_as_inputs_are_folded_and_the_outputs_stay(tmp_path):
    net = Net()
    yolov8(net)
    plain = net.save(tmp_path / "plain.onnx")
    old = onnx.load(plain)
    for weight in old.graph.initializer:
        old.graph.input.append(value(weight.name, list(weight.dims), weight.data_type))
    onnx.save(old, tmp_path / "old.onnx")
    model = onnx.load_from_string(folded((tmp_path / "old.onnx").read_bytes()))
    assert [i.name for i in model.graph.input] == ["in"]
    onnx.checker.check_model(model)
    image = np.random.default_rng(0).integers(0, 256, (128, 192, 3), dtype=np.uint8)
    a, b = (load_detector(tmp_path / f, score_threshold=0.0, names=NAMES) for f in ("plain.onnx", "old.onnx"))
    for x, y in zip(a.detect(image), b.detect(image), strict=True):
        np.testing.assert_array_equal(x, y)


@pytest.mark.parametrize(
    "data", [b"", b"\x3a\x05ab", b"\xff" * 12, b"\x3a\x80\x80\x80\x80\x80\x80\x80\x80\x80\x80\x80\x01"]
)
def test_the_graph_of_what_is_no_model_shows_nothing(data):
    assert class_count(data) is None


def test_the_classes_of_a_network_that_gives_labels_are_in_its_graph():
    nodes = [
        helper.make_node("TopK", ["s", "k"], ["v", "i"]),
        helper.make_node("Mod", ["i", "classes"], ["label"]),
    ]
    for typed in (True, False):
        classes = helper.make_tensor("classes", TensorProto.INT64, [], [11])
        if typed:
            classes = onnx.numpy_helper.from_array(np.array(11, np.int64), "classes")
        k = onnx.numpy_helper.from_array(np.array([3], np.int64), "k")
        graph = helper.make_graph(nodes, "g", [value("s", [1, 33])], [value("v", [1, 3])], [classes, k])
        assert class_count(helper.make_model(graph).SerializeToString()) == 11
