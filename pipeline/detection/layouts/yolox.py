"""YOLOX (https://github.com/Megvii-BaseDetection/YOLOX), decoded in the graph or not, and its older input."""

from __future__ import annotations

from pipeline.config.layout import Layout, Rows
from pipeline.detection.facts import Facts
from pipeline.detection.layouts.proposal import IMAGENET_MEAN, IMAGENET_STD, Proposal, picture_input

name = "yolox"
_STRIDES = (8, 16, 32)
_INPUTS: dict[str, dict[str, object]] = {
    "": {"colour": "bgr", "range": 255.0},
    "_old_input": {"mean": IMAGENET_MEAN, "std": IMAGENET_STD},
}


def propose(facts: Facts) -> list[Proposal]:
    """Rows of box, objectness and classes, one for each cell of the strides 8, 16, 32."""
    if len(facts.outputs) != 1 or facts.others:
        return []
    (output,) = facts.outputs
    if len(output.shape) != 2 or output.shape[0] != facts.cells(*_STRIDES):
        return []
    if not isinstance(output.shape[1], int) or output.shape[1] < 6:
        return []
    found = []
    for grid, suffix in (("yolox", ""), ("none", "_decoded")):
        for old, how in _INPUTS.items():
            layout = Layout(
                input=picture_input(facts, placement="letterbox_top_left", **how),
                output=Rows(tensor=output.name, objectness=True, grid=grid, strides=_STRIDES),
                nms_iou=0.45,
            )
            why = (
                f"{output.shape[0]} rows are one for each cell of the strides {_STRIDES}",
                "boxes as offsets in cells" if grid == "yolox" else "boxes decoded in the graph",
            )
            assumed = () if old else ("the picture as BGR in 0..255, as YOLOX takes it since 0.1.1",)
            found.append(
                Proposal(
                    f"yolox{suffix}{old}",
                    layout,
                    why,
                    output.shape[1] - 5,
                    assumed,
                    usual=not old,
                    grid=_STRIDES,
                )
            )
    return found
