"""YOLOv5 and YOLOv7 (https://github.com/ultralytics/yolov5, https://github.com/WongKinYiu/yolov7)."""

from __future__ import annotations

from pipeline.config.layout import Layout, Rows
from pipeline.detection.facts import Facts
from pipeline.detection.layouts.proposal import Proposal, picture_input

name = "yolov5"
_ANCHORS = 3


def propose(facts: Facts) -> list[Proposal]:
    """Rows of decoded box, objectness and classes, three for each cell of strides 8, 16, 32 (and 64)."""
    rows = [t for t in facts.outputs if len(t.shape) == 2]
    if len(rows) != 1 or facts.others:
        return []
    (output,) = rows
    values = output.shape[1]
    if not isinstance(values, int) or values < 6:
        return []
    for strides in ((8, 16, 32), (8, 16, 32, 64), (16, 32)):
        if output.shape[0] == _ANCHORS * facts.cells(*strides):
            layout = Layout(
                input=picture_input(facts), output=Rows(tensor=output.name, objectness=True), nms_iou=0.45
            )
            why = (f"{output.shape[0]} candidates are three for each cell of the strides {strides}",)
            return [Proposal(name, layout, why, values - 5, grid=strides, anchors=_ANCHORS)]
    return []
