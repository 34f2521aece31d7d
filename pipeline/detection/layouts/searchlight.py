"""Our own detectors (``pipeline.training``): uint8 picture in, boxes and scores out."""

from __future__ import annotations

from pipeline.config.layout import Layout, Pairs
from pipeline.detection.facts import Facts
from pipeline.detection.layouts.proposal import Proposal, picture_input
from pipeline.errors import InputError

name = "searchlight"


def propose(facts: Facts) -> list[Proposal]:
    """Ours say ``layout: searchlight`` in their metadata, and then must keep to all of it."""
    if facts.metadata.get("layout") != name:
        return []
    _require_contract(facts)
    boxes, scores = facts.outputs
    layout = Layout(
        input=picture_input(facts, range=255.0, placement="letterbox_top_left", filter="area"),
        output=Pairs(boxes=boxes.name, scores=scores.name),
        nms_iou=0.5,
    )
    return [Proposal(name, layout, ("its metadata says layout: searchlight",), 1)]


def _require_contract(facts: Facts) -> None:
    """image uint8 (1, H, W, 3) RGB -> boxes (1, N, 4) xyxy in input pixels, scores (1, N) in 0..1."""
    shapes = [tuple(t.shape) for t in facts.outputs]
    rules = (
        (not facts.others, "one input", f"{1 + len(facts.others)}"),
        (facts.picture.dtype == "uint8", "an input of uint8", facts.picture.dtype),
        (facts.axes == "nhwc", "an input (1, height, width, 3)", str(facts.picture)),
        (
            all(isinstance(size, int) for size in facts.picture.shape[1:3]),
            "an input of fixed height and width",
            str(facts.picture),
        ),
        (len(shapes) == 2, "two outputs, boxes and scores", f"{len(shapes)} outputs"),
        (
            len(shapes) == 2 and len(shapes[0]) == 2 and shapes[0][1] == 4,
            "boxes (1, N, 4) first",
            str(shapes),
        ),
        (
            len(shapes) == 2 and shapes[1] == shapes[0][:1],
            "scores (1, N) second, N as of the boxes",
            str(shapes),
        ),
    )
    for kept, rule, found in rules:
        if not kept:
            raise InputError("layout: searchlight in its metadata", found, rule)
