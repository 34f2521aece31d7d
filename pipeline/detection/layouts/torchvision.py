"""torchvision's detection models (https://pytorch.org/vision): a picture as it is, without a batch."""

from __future__ import annotations

from pipeline.config.layout import Chosen, Layout
from pipeline.detection.facts import Facts, is_float, is_whole
from pipeline.detection.layouts.proposal import Proposal, picture_input

name = "torchvision"


def propose(facts: Facts) -> list[Proposal]:
    """(3, H, W) in 0..1 -> boxes (N, 4) in its pixels, labels (N,) from 1, scores (N,)."""
    if facts.others or facts.axes != "chw" or len(facts.outputs) != 3:
        return []
    shapes = {t.name: facts.shapes[t.name] for t in facts.outputs}
    boxes = [t for t in facts.outputs if shapes[t.name][-1:] == (4,) and len(shapes[t.name]) == 2]
    labels = [t for t in facts.outputs if is_whole(t)]
    scores = [t for t in facts.outputs if is_float(t) and t not in boxes]
    if not (len(boxes) == len(labels) == len(scores) == 1):
        return []
    layout = Layout(
        input=picture_input(facts, placement="stretched"),
        output=Chosen(boxes=boxes[0].name, scores=scores[0].name, labels=labels[0].name),
        first_class=1,
    )
    why = ("a picture without a batch axis, and boxes, whole-numbered labels and scores",)
    return [Proposal(name, layout, why, None)]
