"""DAMO-YOLO, YOLO-NAS and YOLO-World with its texts folded in: decoded boxes beside scores."""

from __future__ import annotations

from pipeline.config.layout import Layout, Pairs
from pipeline.detection.facts import Facts, Tensor, is_float
from pipeline.detection.layouts.proposal import Proposal, picture_input

name = "damoyolo"
_STRIDES = (8, 16, 32)
_INPUTS: dict[str, dict[str, object]] = {
    "damoyolo": {"range": 255.0, "placement": "letterbox_top_left", "fill": 0},
    "yolo_nas": {},
}


def propose(facts: Facts) -> list[Proposal]:
    """Scores (cells, classes) and boxes (cells, 4) xyxy in pixels of the input."""
    if facts.others:
        return []
    found = boxes_and_scores(facts, facts.cells(*_STRIDES))
    if found is None:
        return []
    boxes, scores = found
    why = (f"scores and boxes, {boxes.shape[0]}, one for each cell of the strides {_STRIDES}",)
    classes = scores.shape[1] if len(scores.shape) == 2 else 1
    return [
        Proposal(
            which,
            Layout(
                input=picture_input(facts, **how),
                output=Pairs(boxes=boxes.name, scores=scores.name),
                nms_iou=0.6,
            ),
            why,
            int(classes or 1),
            grid=_STRIDES,
        )
        for which, how in _INPUTS.items()
    ]


def boxes_and_scores(facts: Facts, places: int | None) -> tuple[Tensor, Tensor] | None:
    """The two outputs (places, 4) and (places, classes); None if they are not, or both could be the boxes."""
    if len(facts.outputs) != 2 or not all(is_float(t) for t in facts.outputs):
        return None
    boxes = [t for t in facts.outputs if len(t.shape) == 2 and t.shape[1] == 4]
    if len(boxes) == 2:  # four classes: the names are all there is
        boxes = [t for t in boxes if any(word in t.name.lower() for word in ("box", "det"))]
    if len(boxes) != 1:
        return None
    (box,) = boxes
    (scores,) = (t for t in facts.outputs if t != box)
    same = len(scores.shape) in (1, 2) and scores.shape[0] == box.shape[0]
    return (box, scores) if same and places in (None, box.shape[0]) else None
