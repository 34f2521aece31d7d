"""SSD and its relatives of TensorFlow's Object Detection API, as tf2onnx writes them."""

from __future__ import annotations

from pipeline.config.layout import Chosen, Layout
from pipeline.detection.facts import Facts, Tensor, is_float
from pipeline.detection.layouts.proposal import Proposal, picture_input

name = "tf_ssd"


def propose(facts: Facts) -> list[Proposal]:
    """uint8 (1, H, W, 3); boxes (N, 4) y, x, y, x in shares, scores (N,), classes (N,) from 1, and a count."""
    if facts.others or facts.axes != "nhwc":
        return []
    boxes = [t for t in facts.outputs if len(t.shape) == 2 and t.shape[1] == 4 and is_float(t)]
    boxes = _preferring(boxes, "detection_boxes")
    if len(boxes) != 1:
        return []
    (box,) = boxes
    lists = [t for t in facts.outputs if t.shape == (box.shape[0],)]
    counts = [t for t in facts.outputs if t.shape in ((), (1,)) and t not in lists]
    parts = _scores_and_classes(facts, lists)
    if parts is None or len(counts) != 1:
        return []
    scores, classes = parts
    layout = Layout(
        input=picture_input(facts, range=255.0, placement="stretched"),
        output=Chosen(
            boxes=box.name,
            scores=scores.name,
            labels=classes.name,
            count=counts[0].name,
            box="yxyx",
            unit="shares",
        ),
        first_class=1,
    )
    why = ("a picture in rows and columns, and boxes, scores, classes and a count",)
    return [Proposal(name, layout, why, None)]


def _scores_and_classes(facts: Facts, lists: list[Tensor]) -> tuple[Tensor, Tensor] | None:
    """By their names, or else by their values for the trial picture: classes are whole numbers from 1."""
    scores, classes = _preferring(lists, "scores"), _preferring(lists, "classes")
    if len(scores) == 1 and len(classes) == 1 and scores != classes:
        return scores[0], classes[0]
    if len(lists) != 2:
        return None
    fractions = [t for t in lists if t.name in facts.values and (facts.values[t.name] % 1).any()]
    if len(fractions) != 1:
        return None
    return fractions[0], next(t for t in lists if t != fractions[0])


def _preferring(tensors: list[Tensor], word: str) -> list[Tensor]:
    named = [t for t in tensors if word in t.name and "multiclass" not in t.name and "raw" not in t.name]
    return named or tensors
