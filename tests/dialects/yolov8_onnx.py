"""One of the shipped detectors as somebody's own: the same network, with the inputs and outputs of a YOLOv8 export."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

#: YOLOv8 has a candidate for each cell of these; ours has one for each of the first
STRIDES = (8, 16, 32)


def write(path: Path, shipped: Path) -> None:
    """images (1, 3, H, W) in 0..1 -> output0 (1, 5, cells): centre, width, height in pixels, and a score."""
    model = onnx.load(str(shipped))
    graph = model.graph
    _, height, width, _ = (d.dim_value for d in graph.input[0].type.tensor_type.shape.dim)
    count = graph.output[1].type.tensor_type.shape.dim[1].dim_value
    cells = sum((height // s) * (width // s) for s in STRIDES)
    picture, boxes, scores = graph.input[0].name, graph.output[0].name, graph.output[1].name
    numbers = {
        "own_255": np.float32(255.0),
        "own_half": np.float32(0.5),
        "own_axis": np.array([1]),
        "own_nobody": np.zeros((1, 5, cells - count), np.float32),
    }
    before = [
        helper.make_node("Transpose", ["images"], ["own_nhwc"], perm=[0, 2, 3, 1]),
        helper.make_node("Mul", ["own_nhwc", "own_255"], ["own_scaled"]),
        helper.make_node("Round", ["own_scaled"], ["own_whole"]),
        helper.make_node("Cast", ["own_whole"], [picture], to=TensorProto.UINT8),
    ]
    after = [
        helper.make_node("Transpose", [boxes], ["own_columns"], perm=[0, 2, 1]),
        helper.make_node("Split", ["own_columns"], ["own_least", "own_most"], axis=1),
        helper.make_node("Add", ["own_least", "own_most"], ["own_sum"]),
        helper.make_node("Mul", ["own_sum", "own_half"], ["own_centre"]),
        helper.make_node("Sub", ["own_most", "own_least"], ["own_size"]),
        helper.make_node("Unsqueeze", [scores, "own_axis"], ["own_score"]),
        helper.make_node("Concat", ["own_centre", "own_size", "own_score"], ["own_found"], axis=1),
        helper.make_node("Concat", ["own_found", "own_nobody"], ["output0"], axis=2),
    ]
    own = helper.make_graph(
        [*before, *graph.node, *after],
        "own",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, height, width])],
        [helper.make_tensor_value_info("output0", TensorProto.FLOAT, [1, 5, cells])],
        [*graph.initializer, *(numpy_helper.from_array(np.asarray(v), n) for n, v in numbers.items())],
    )
    result = helper.make_model(own, opset_imports=model.opset_import, ir_version=model.ir_version)
    helper.set_model_props(result, {"task": "detect", "names": "{0: 'person'}"})
    onnx.checker.check_model(result)
    onnx.save(result, str(path))
