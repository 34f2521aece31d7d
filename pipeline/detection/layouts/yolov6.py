"""YOLOv6 (https://github.com/meituan/YOLOv6): rows as YOLOX's, with an objectness that is always 1."""

from __future__ import annotations

from pipeline.config.layout import Layout, Rows
from pipeline.detection.facts import Facts
from pipeline.detection.layouts.proposal import Proposal, picture_input

name = "yolov6"


def propose(facts: Facts) -> list[Proposal]:
    """Rows of decoded box, 1 and classes for each cell of strides 8, 16, 32 (and 64)."""
    if len(facts.outputs) != 1 or facts.others:
        return []
    (output,) = facts.outputs
    if len(output.shape) != 2 or not isinstance(output.shape[1], int) or output.shape[1] < 6:
        return []
    for strides in ((8, 16, 32), (8, 16, 32, 64)):
        if output.shape[0] == facts.cells(*strides):
            layout = Layout(
                input=picture_input(facts), output=Rows(tensor=output.name, objectness=True), nms_iou=0.45
            )
            why = (f"{output.shape[0]} rows are one for each cell of the strides {strides}",)
            return [Proposal(name, layout, why, output.shape[1] - 5, grid=strides)]
    return []
