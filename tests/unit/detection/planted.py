"""Small networks with planted weights, exported in each layout.

All see the same: a cell of 8 x 8 pixels of the network's input that is pure red is a person 24 wide and 40
high around the cell's middle. Only a picture in the right colour order, range, mean and std shows pure red.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

WIDTH, HEIGHT = 192, 128
PERSON_WH = (24.0, 40.0)
MEAN, STD = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
MEAN_BGR, STD_BGR = np.array([103.53, 116.28, 123.675]), np.array([57.375, 57.12, 58.395])
ZERO, ONE = np.zeros(3), np.ones(3)
DTYPES = {"float32": TensorProto.FLOAT, "float16": TensorProto.FLOAT16, "uint8": TensorProto.UINT8}


@dataclass
class Net:
    """A graph in the making."""

    strides: tuple[int, ...] = (8, 16, 32)
    bgr: bool = False
    range: float = 1.0
    mean: np.ndarray = field(default_factory=lambda: ZERO)
    std: np.ndarray = field(default_factory=lambda: ONE)
    axes: str = "nchw"
    dtype: str = "float32"
    free: bool = False
    classes: int = 3
    person: int = 1
    nodes: list = field(default_factory=list)
    weights: list = field(default_factory=list)
    inputs: list = field(default_factory=list)
    outputs: list = field(default_factory=list)
    metadata: dict = field(default_factory=dict)

    def const(self, value, dtype=np.float32) -> str:
        name = f"w{len(self.weights)}"
        self.weights.append(numpy_helper.from_array(np.asarray(value, dtype), name))
        return name

    def op(self, kind: str, *inputs: str, out: str | None = None, outs: int = 1, **attributes):
        names = (
            [out or f"t{len(self.nodes)}"] if outs == 1 else [f"t{len(self.nodes)}_{k}" for k in range(outs)]
        )
        self.nodes.append(helper.make_node(kind, list(inputs), names, **attributes))
        return names[0] if outs == 1 else names

    def score(self) -> str:
        """(1, N): 0.95 where the cell is pure red, of all cells of all strides."""
        shape = {"nchw": [1, 3, HEIGHT, WIDTH], "nhwc": [1, HEIGHT, WIDTH, 3], "chw": [3, HEIGHT, WIDTH]}[
            self.axes
        ]
        if self.free:
            shape = {"nchw": ["b", 3, "h", "w"], "nhwc": ["b", "h", "w", 3], "chw": [3, "h", "w"]}[self.axes]
        self.inputs.insert(0, helper.make_tensor_value_info("in", DTYPES[self.dtype], shape))
        x = self.op("Cast", "in", to=TensorProto.FLOAT)
        if self.axes == "nhwc":
            x = self.op("Transpose", x, perm=[0, 3, 1, 2])
        if self.axes == "chw":
            x = self.op("Unsqueeze", x, self.const([0], np.int64))
        x = self.op("Mul", x, self.const(self.std.reshape(1, 3, 1, 1)))
        x = self.op("Add", x, self.const(self.mean.reshape(1, 3, 1, 1)))
        x = self.op("Div", x, self.const(self.range))
        red = [0, 0, 1] if self.bgr else [1, 0, 0]
        x = self.op("Abs", self.op("Sub", x, self.const(np.reshape(red, (1, 3, 1, 1)))))
        x = self.op("ReduceMax", x, axes=[1], keepdims=1)
        x = self.op("Relu", self.op("Sub", self.const(0.95), self.op("Mul", x, self.const(8.0))))
        flat = [
            self.op(
                "Reshape",
                self.op("AveragePool", x, kernel_shape=[s, s], strides=[s, s]),
                self.const([0, -1], np.int64),
            )
            for s in self.strides
        ]
        return self.op("Concat", *flat, axis=1) if len(flat) > 1 else flat[0]

    def cells(self) -> tuple[np.ndarray, np.ndarray]:
        """Corner column and row (N, 2), stride (N, 1)."""
        cells, sizes = [], []
        for s in self.strides:
            y, x = np.mgrid[: HEIGHT // s, : WIDTH // s]
            cells.append(np.stack([x.ravel(), y.ravel()], 1))
            sizes.append(np.full((x.size, 1), s))
        return np.concatenate(cells).astype(float), np.concatenate(sizes).astype(float)

    def boxes(self, form: str = "cxcywh", shares: bool = False) -> np.ndarray:
        """(N, 4): around every cell's middle."""
        cells, stride = self.cells()
        middle = (cells + 0.5) * stride
        size = np.tile(PERSON_WH, (len(middle), 1))
        boxes = np.concatenate([middle, size], 1)
        if form != "cxcywh":
            boxes = np.concatenate([middle - size / 2, middle + size / 2], 1)
        if form == "yxyx":
            boxes = boxes[:, [1, 0, 3, 2]]
        if shares:
            boxes = boxes / ([WIDTH, HEIGHT] * 2 if form != "yxyx" else [HEIGHT, WIDTH] * 2)
        return boxes

    def class_scores(self, score: str, columns: bool = False) -> str:
        """(1, N, K) or (1, K, N): the score for the person, 0 for the others."""
        one_hot = np.eye(self.classes)[self.person]
        axis, shape = (1, (1, -1, 1)) if columns else (2, (1, 1, -1))
        return self.op(
            "Mul",
            self.op("Unsqueeze", score, self.const([axis], np.int64)),
            self.const(one_hot.reshape(shape)),
        )

    def best(self, score: str, count: int = 4):
        """Values (1, count) and places (count,) of the highest scores."""
        values, place = self.op("TopK", score, self.const([count], np.int64), outs=2, axis=1)
        return values, self.op("Reshape", place, self.const([-1], np.int64))

    def give(self, tensor: str, name: str, shape, dtype: int = TensorProto.FLOAT) -> None:
        self.op("Identity", tensor, out=name)
        self.outputs.append(helper.make_tensor_value_info(name, dtype, shape))

    def save(self, path: Path, external: bool = False) -> Path:
        graph = helper.make_graph(self.nodes, "planted", self.inputs, self.outputs, self.weights)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
        helper.set_model_props(model, {k: str(v) for k, v in self.metadata.items()})
        onnx.save(
            model, path, save_as_external_data=external, location=f"{path.name}.data", size_threshold=500
        )
        return path


def spot(net: Net, x: int = 5, y: int = 4) -> tuple[np.ndarray, list[float]]:
    """A picture twice the input's size with one red cell of stride 8, and the person's box in it."""
    image = np.full((2 * HEIGHT, 2 * WIDTH, 3), 90, np.uint8)
    image[16 * y : 16 * y + 16, 16 * x : 16 * x + 16] = [255, 0, 0]
    cx, cy = 16 * x + 8, 16 * y + 8
    return image, [cx - 24.0, cy - 40.0, cx + 24.0, cy + 40.0]


def yolov8(n: Net) -> None:
    s = n.score()
    rows = n.op("Concat", n.const(n.boxes().T[None]), n.class_scores(s, columns=True), axis=1)
    n.give(rows, "y", [1, 4 + n.classes, None])


def yolov8_turned(n: Net) -> None:
    s = n.score()
    rows = n.op("Concat", n.const(n.boxes()[None]), n.class_scores(s), axis=2)
    n.give(rows, "y", [1, None, 4 + n.classes])


def _objectness(n: Net, boxes: np.ndarray, repeat: int = 1, ones: bool = False) -> None:
    s = n.score()
    if repeat > 1:  # anchors one after the other for each stride, as YOLOv5 lays them out
        _, stride = n.cells()
        parts = [np.flatnonzero(stride[:, 0] == k) for k in n.strides]
        order = np.concatenate([np.tile(p, repeat) for p in parts])
        s, boxes = n.op("Gather", s, n.const(order, np.int64), axis=1), boxes[order]
    if ones:
        objectness, classes = n.const(np.ones((1, len(boxes), 1))), n.class_scores(s)
    else:
        objectness = n.op("Unsqueeze", s, n.const([2], np.int64))
        classes = n.const(np.tile(np.eye(n.classes)[n.person], (1, len(boxes), 1)))
    nought = n.op("Mul", objectness if not ones else classes, n.const(0.0))  # as many as there are pictures
    if not ones:
        classes = n.op("Add", classes, nought)
    boxes = n.op("Add", n.const(boxes[None]), n.op("ReduceMax", nought, axes=[2], keepdims=1))
    n.give(n.op("Concat", boxes, objectness, classes, axis=2), "y", [None, None, 5 + n.classes])


def yolov5(n: Net) -> None:
    _objectness(n, n.boxes(), 3)


def yolox_decoded(n: Net) -> None:
    _objectness(n, n.boxes())


def yolox(n: Net) -> None:
    _, stride = n.cells()
    _objectness(n, np.concatenate([np.full((len(stride), 2), 0.5), np.log(n.boxes()[:, 2:] / stride)], 1))


def yolov6(n: Net) -> None:
    _objectness(n, n.boxes(), ones=True)


def yolov10(n: Net) -> None:
    values, place = n.best(n.score())
    boxes = n.op("Unsqueeze", n.op("Gather", n.const(n.boxes("xyxy")), place, axis=0), n.const([0], np.int64))
    label = n.const(np.full((1, 4, 1), n.person))
    rows = n.op("Concat", boxes, n.op("Unsqueeze", values, n.const([2], np.int64)), label, axis=2)
    n.give(rows, "y", [1, 4, 6])


def yolov7_end2end(n: Net) -> None:
    values, place = n.best(n.score())
    boxes = n.op("Gather", n.const(n.boxes("xyxy")), place, axis=0)
    column = n.op("Reshape", values, n.const([-1, 1], np.int64))
    rows = n.op(
        "Concat", n.const(np.zeros((4, 1))), boxes, n.const(np.full((4, 1), n.person)), column, axis=1
    )
    n.give(rows, "y", ["objects", 7])


def rtdetr_ultralytics(n: Net) -> None:
    s = n.score()
    rows = n.op("Concat", n.const(n.boxes(shares=True)[None]), n.class_scores(s), axis=2)
    keep = n.const(np.arange(384), np.int64)  # all of stride 8
    n.give(n.op("Gather", rows, keep, axis=1), "y", [1, 384, 4 + n.classes])


def tensorrt_nms(n: Net) -> None:
    values, place = n.best(n.score())
    boxes = n.op("Unsqueeze", n.op("Gather", n.const(n.boxes("xyxy")), place, axis=0), n.const([0], np.int64))
    n.give(n.const([[1]], np.int32), "a", [1, 1], TensorProto.INT32)
    n.give(boxes, "b", [1, 4, 4])
    n.give(values, "c", [1, 4])
    n.give(n.const([[n.person] * 4], np.int32), "d", [1, 4], TensorProto.INT32)


def onnx_nms(n: Net) -> None:
    s = n.score()
    classes, boxes = n.class_scores(s, columns=True), n.const(n.boxes()[None])
    picked = n.op(
        "NonMaxSuppression",
        boxes,
        classes,
        n.const([10], np.int64),
        n.const([0.5]),
        n.const([0.2]),
        center_point_box=1,
    )
    n.give(picked, "a", ["m", 3], TensorProto.INT64)
    n.give(boxes, "b", [1, None, 4])
    n.give(classes, "c", [1, n.classes, None])


def mmdetection(n: Net) -> None:
    values, place = n.best(n.score())
    boxes = n.op("Unsqueeze", n.op("Gather", n.const(n.boxes("xyxy")), place, axis=0), n.const([0], np.int64))
    n.give(n.op("Concat", boxes, n.op("Unsqueeze", values, n.const([2], np.int64)), axis=2), "a", [1, 4, 5])
    n.give(n.const([[n.person] * 4], np.int64), "b", [1, 4], TensorProto.INT64)


def _distances(n: Net) -> np.ndarray:
    """(N, 32): distributions whose means are the person's edges, in cells; nought where it is out of reach."""
    _, stride = n.cells()
    half = np.array([12.0, 20.0, 12.0, 20.0])[None] / stride
    spread = np.full((len(stride), 4, 8), -50.0)
    low = np.minimum(np.floor(half), 6).astype(int)
    part = np.clip(half - low, 1e-6, 1 - 1e-6)
    np.put_along_axis(spread, low[..., None], np.log(1 - part)[..., None], 2)
    np.put_along_axis(spread, low[..., None] + 1, np.log(part)[..., None], 2)
    return spread.reshape(len(stride), 32)


def nanodet(n: Net) -> None:
    s = n.class_scores(n.score())
    _, stride = n.cells()
    for name in ("score", "spread"):
        for k in n.strides:
            place = n.const(np.flatnonzero(stride[:, 0] == k), np.int64)
            source = s if name == "score" else n.const(_distances(n)[None])
            values = n.classes if name == "score" else 32
            n.give(n.op("Gather", source, place, axis=1), f"{name}{k}", [1, None, values])


def nanodet_plus(n: Net) -> None:
    s = n.class_scores(n.score())
    _, stride = n.cells()  # its priors are the cells' corners: the person lies half a cell further on
    shifted = _distances(n)
    half = np.array([12.0, 20.0, 12.0, 20.0])[None] / stride + np.array([-0.5, -0.5, 0.5, 0.5])
    spread = np.full((len(stride), 4, 8), -50.0)
    low = np.clip(np.floor(half), 0, 6).astype(int)
    part = np.clip(half - low, 1e-6, 1 - 1e-6)
    np.put_along_axis(spread, low[..., None], np.log(1 - part)[..., None], 2)
    np.put_along_axis(spread, low[..., None] + 1, np.log(part)[..., None], 2)
    both = n.op("Concat", s, n.const(spread.reshape(1, len(shifted), 32)), axis=2)
    n.give(both, "y", [1, None, n.classes + 32])


def picodet_with_nms(n: Net) -> None:
    values, place = n.best(n.score())
    boxes = n.op("Gather", n.const(n.boxes("xyxy")), place, axis=0)
    column = n.op("Reshape", values, n.const([-1, 1], np.int64))
    n.inputs.append(helper.make_tensor_value_info("factor", TensorProto.FLOAT, [1, 2]))
    scale = n.op("Concat", "factor", "factor", axis=1)
    boxes = n.op("Div", boxes, scale)
    n.give(n.op("Concat", n.const(np.full((4, 1), n.person)), column, boxes, axis=1), "a", [None, 6])
    n.give(n.const([4], np.int32), "b", [1], TensorProto.INT32)


def fastestdet(n: Net) -> None:
    s = n.op("Reshape", n.score(), n.const([1, 1, HEIGHT // 16, WIDTH // 16], np.int64))
    planes = np.zeros((1, 4 + n.classes, HEIGHT // 16, WIDTH // 16))
    share = np.array(PERSON_WH) / [WIDTH, HEIGHT]
    planes[0, :2], planes[0, 2:4] = np.arctanh(0.5), np.log(share / (1 - share))[:, None, None]
    planes[0, 4 + n.person] = 1.0
    n.give(n.op("Concat", s, n.const(planes), axis=1), "y", [1, 5 + n.classes, None, None])


def yolo_fastestv2(n: Net) -> None:
    s = n.score()
    _, stride = n.cells()
    for k, anchor in ((16, (12.64, 19.39)), (32, (126.91, 78.23))):
        high, wide = HEIGHT // k, WIDTH // k
        part = n.op("Gather", s, n.const(np.flatnonzero(stride[:, 0] == k), np.int64), axis=1)
        part = n.op("Reshape", part, n.const([1, high, wide, 1], np.int64))
        box = np.tile([0.5, 0.5, *(np.sqrt(np.array(PERSON_WH) / anchor) / 2)], (1, high, wide, 1))
        others = np.tile([0.5, 0.5, 0.1, 0.1] * 2, (1, high, wide, 1))
        classes = np.tile(np.eye(n.classes)[n.person], (1, high, wide, 1))
        nothing = n.const(np.zeros((1, high, wide, 2)))
        n.give(
            n.op("Concat", n.const(box), n.const(others), part, nothing, n.const(classes), axis=3),
            f"y{k}",
            [1, high, wide, 15 + n.classes],
        )


def damo(n: Net) -> None:
    n.give(n.class_scores(n.score()), "a", [1, None, n.classes])
    n.give(n.const(n.boxes("xyxy")[None]), "b", [1, None, 4])


def rtdetr(n: Net) -> None:
    """Logits of the cells of stride 8 and boxes in shares."""
    s = n.class_scores(n.score())
    clipped = n.op("Clip", s, n.const(1e-4), n.const(1 - 1e-4))
    logits = n.op("Log", n.op("Div", clipped, n.op("Sub", n.const(1.0), clipped)))
    n.give(logits, "a", [1, None, n.classes])
    n.give(n.const(n.boxes(shares=True)[None]), "b", [1, None, 4])


def rtdetr_with_sizes(n: Net) -> None:
    values, place = n.best(n.score())
    n.inputs.append(helper.make_tensor_value_info("sizes", TensorProto.INT64, ["b", 2]))
    boxes = n.op("Gather", n.const(n.boxes("xyxy", shares=True)), place, axis=0)
    wide = n.op("Cast", n.op("Concat", "sizes", "sizes", axis=1), to=TensorProto.FLOAT)
    n.give(n.const([[n.person] * 4], np.int64), "a", [1, 4], TensorProto.INT64)
    n.give(n.op("Unsqueeze", n.op("Mul", boxes, wide), n.const([0], np.int64)), "b", [1, 4, 4])
    n.give(values, "c", [1, 4])


def tf_ssd(n: Net) -> None:
    values, place = n.best(n.score())
    boxes = n.op(
        "Unsqueeze",
        n.op("Gather", n.const(n.boxes("yxyx", shares=True)), place, axis=0),
        n.const([0], np.int64),
    )
    n.give(n.const([4.0]), "num_detections", [1])
    n.give(boxes, "detection_boxes", [1, 4, 4])
    n.give(values, "detection_scores", [1, 4])
    n.give(n.const([[n.person + 1.0] * 4]), "detection_classes", [1, 4])


def torchvision(n: Net) -> None:
    values, place = n.best(n.score())
    n.give(n.op("Gather", n.const(n.boxes("xyxy")), place, axis=0), "a", [None, 4])
    n.give(n.const([n.person + 1] * 4, np.int64), "b", [None], TensorProto.INT64)
    n.give(n.op("Reshape", values, n.const([-1], np.int64)), "c", [None])
