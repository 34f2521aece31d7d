"""FastestDet (https://github.com/dog-qiuqiu/FastestDet): one grid, objectness beside classes."""

from __future__ import annotations

from pipeline.config.layout import Cells, Layout
from pipeline.detection.facts import Facts
from pipeline.detection.layouts.proposal import Proposal, picture_input

name = "fastestdet"
_STRIDE = 16


def propose(facts: Facts) -> list[Proposal]:
    """One map (5 + classes, rows, columns) at stride 16."""
    if len(facts.outputs) != 1 or facts.others:
        return []
    (output,) = facts.outputs
    if len(output.shape) != 3 or not isinstance(output.shape[0], int) or output.shape[0] < 6:
        return []
    if output.shape[1:] != (-(-facts.height // _STRIDE), -(-facts.width // _STRIDE)):
        return []
    layout = Layout(
        input=picture_input(facts, colour="bgr", placement="stretched"),
        output=Cells(tensor=output.name, stride=_STRIDE),
        nms_iou=0.6,
    )
    why = (f"one map of {output.shape[0]} planes at stride 16: objectness, a box and classes",)
    return [Proposal(name, layout, why, output.shape[0] - 5)]
