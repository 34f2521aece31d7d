"""Layers of the map and the detectors that know them."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.allocation.plan import Assignment
from pipeline.config.pool import Pool
from pipeline.errors import InputError
from pipeline.mission.detectors import look_at_detectors, require_planned_layers

NANO = Path(__file__).parents[3] / "configs" / "detectors" / "nano.onnx"


def pool(*rows: dict) -> Pool:
    common = {
        "model": NANO,
        "memory": {"megabytes": 50},
        "accuracy": [{"bitrate": {"mbps": 1}, "accuracy": 0.4}],
        "times": [{"machine": "m", "mean": {"seconds": 0.1}}],
    }
    return Pool.model_validate({"detectors": [common | {"id": f"d{k}"} | r for k, r in enumerate(rows)]})


def test_a_layer_that_no_detector_of_the_pool_knows_is_refused():
    with pytest.raises(InputError, match=r"pool\.yaml classes\.boat: found no detector of the pool \(d0\)"):
        look_at_detectors(pool({}), {"person": 0, "boat": 1}, Path("pool.yaml"))


def test_a_layer_that_no_planned_detector_knows_is_refused():
    look = look_at_detectors(
        pool({}, {"classes": {"boat": ["person"]}}), {"person": 0, "boat": 1}, Path("pool.yaml")
    )
    assert look.known == {"d0": {"person"}, "d1": {"person", "boat"}}

    def planned(*names):
        return tuple(Assignment("v", f"m:{n}", n, "m", "s", 1, 0, 1e6) for n in names)

    layers = {"person": 0, "boat": 1}
    require_planned_layers(layers, look.known, planned("d0", "d1"), Path("mission.yaml"))
    with pytest.raises(InputError, match=r"no planned detector \(d0\) that knows boat"):
        require_planned_layers(layers, look.known, planned("d0"), Path("mission.yaml"))


def test_what_was_assumed_of_a_model_is_a_finding(tmp_path):
    onnx = pytest.importorskip("onnx", reason="onnx is not installed")
    from onnx import TensorProto, helper

    graph = helper.make_graph(
        [helper.make_node("Identity", ["w"], ["y"])],
        "g",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, 3, 64, 64])],
        [helper.make_tensor_value_info("y", TensorProto.FLOAT, [1, 5, 84])],
        [helper.make_tensor("w", TensorProto.FLOAT, [1, 5, 84], [0.0] * 420)],
    )
    path = tmp_path / "one.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), path)
    look = look_at_detectors(pool({"model": path}), {"person": 0}, Path("pool.yaml"))
    said = [str(finding) for finding in look.findings]
    assert any("its one class is a person" in line for line in said)
    assert all(line.startswith("assumed: detector d0") for line in said)
