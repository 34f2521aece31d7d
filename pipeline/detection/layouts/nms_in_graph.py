"""Networks whose graph ends with a non-maximum suppression."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.config.layout import Chosen, Layout, Pairs
from pipeline.detection.facts import Facts, Tensor, is_float, is_whole
from pipeline.detection.layouts.proposal import Proposal, picture_input

name = "nms_in_graph"


def propose(facts: Facts) -> list[Proposal]:
    """TensorRT's four outputs, MMDetection's two, or ONNX's NonMaxSuppression with what it chose from."""
    if facts.others or facts.axes != "nchw":
        return []
    return [*_tensorrt(facts), *_mmdetection(facts), *_indices(facts)]


def _tensorrt(facts: Facts) -> Sequence[Proposal]:
    """num_dets (1, 1), boxes (1, N, 4), scores (1, N), classes (1, N); whatever their names and order."""
    if len(facts.outputs) != 4:
        return []
    boxes = [t for t in facts.outputs if len(t.shape) == 2 and t.shape[1] == 4]
    if len(boxes) != 1:
        return []
    (box,) = boxes
    lists = [t for t in facts.outputs if t.shape == (box.shape[0],)]
    counts = [t for t in facts.outputs if t.shape in ((), (1,)) and t not in lists]
    score, label = [t for t in lists if is_float(t)], [t for t in lists if is_whole(t)]
    if not (len(score) == len(label) == len(counts) == 1):
        return []
    layout = Layout(
        input=picture_input(facts),
        output=Chosen(boxes=box.name, scores=score[0].name, labels=label[0].name, count=counts[0].name),
    )
    why = ("a count, boxes, scores and whole-numbered classes, as TensorRT's NMS gives them",)
    assumed = ("the picture as RGB in 0..1, letterboxed in the middle, as YOLOv5, v6, v7, v8 take it",)
    return [Proposal("tensorrt_nms", layout, why, None, assumed)]


def _mmdetection(facts: Facts) -> Sequence[Proposal]:
    """dets (1, N, 5) with the score last, labels (1, N): boxes are right, the input's mean and std are not known."""
    if len(facts.outputs) != 2:
        return []
    dets = [t for t in facts.outputs if len(t.shape) == 2 and t.shape[1] == 5 and is_float(t)]
    labels = [t for t in facts.outputs if len(t.shape) == 1 and is_whole(t)]
    if len(dets) != 1 or len(labels) != 1 or dets[0].shape[0] != labels[0].shape[0]:
        return []
    output = Chosen(boxes=dets[0].name, columns=("x0", "y0", "x1", "y1", "score"), labels=labels[0].name)
    why = ("boxes with scores, and labels, as MMDetection's exports give them",)
    mean, std = (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)
    inputs = {
        "mmdetection": {
            "range": 255.0,
            "mean": mean,
            "std": std,
            "placement": "letterbox_top_left",
            "fill": 0,
        },
        "mmdetection_rtmdet": {
            "range": 255.0,
            "colour": "bgr",
            "mean": mean[::-1],
            "std": std[::-1],
            "placement": "letterbox_top_left",
        },
    }
    return [
        Proposal(which, Layout(input=picture_input(facts, **how), output=output), why, None)
        for which, how in inputs.items()
    ]


def _indices(facts: Facts) -> Sequence[Proposal]:
    """selected (M, 3) whole numbers, boxes (N, 4), scores (classes, N)."""
    chosen = [t for t in facts.outputs if is_whole(t) and _last(t) == 3]
    boxes = [t for t in facts.outputs if is_float(t) and len(t.shape) == 2 and t.shape[1] == 4]
    if len(facts.outputs) != 3 or len(chosen) != 1 or len(boxes) != 1:
        return []
    places = boxes[0].shape[0]
    scores = [t for t in facts.outputs if t not in (chosen[0], boxes[0]) and t.shape[-1:] == (places,)]
    if len(scores) != 1:
        return []
    classes = scores[0].shape[0] if len(scores[0].shape) == 2 else 1
    why = ("what ONNX's NonMaxSuppression chose, and the boxes and scores that it chose from",)
    forms = {"onnx_nms": "cxcywh", "onnx_nms_xyxy": "xyxy", "onnx_nms_yxyx": "yxyx"}
    found = []
    for which, form in forms.items():
        output = Pairs(
            boxes=boxes[0].name,
            scores=scores[0].name,
            scores_order="columns",
            selected=chosen[0].name,
            box=form,
        )
        layout = Layout(input=picture_input(facts), output=output)
        found.append(Proposal(which, layout, (*why, f"boxes {form}"), int(classes or 1)))
    return found


def _last(tensor: Tensor) -> object:
    return tensor.shape[-1] if tensor.shape else None
