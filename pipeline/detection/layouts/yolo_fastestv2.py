"""YOLO-FastestV2 (https://github.com/dog-qiuqiu/Yolo-FastestV2)."""

from __future__ import annotations

from pipeline.config.layout import Anchors, Layout
from pipeline.detection.facts import Facts
from pipeline.detection.layouts.proposal import Proposal, picture_input

name = "yolo_fastestv2"
_STRIDES = (16, 32)
#: of its COCO model, in pixels of 352 x 352
_COCO = (
    ((12.64, 19.39), (37.88, 51.48), (55.71, 138.31)),
    ((126.91, 78.23), (131.57, 214.55), (279.92, 258.87)),
)


def propose(facts: Facts) -> list[Proposal]:
    """Two maps (rows, columns, 15 + classes) at strides 16 and 32."""
    if len(facts.outputs) != 2 or facts.others:
        return []
    by_stride = []
    for stride in _STRIDES:
        shape = (-(-facts.height // stride), -(-facts.width // stride))
        same = [t for t in facts.outputs if len(t.shape) == 3 and t.shape[:2] == shape]
        by_stride += same[:1]
    if len(by_stride) != 2 or by_stride[0].shape[2] != by_stride[1].shape[2]:
        return []
    values = by_stride[0].shape[2]
    if not isinstance(values, int) or values < 16:
        return []
    layout = Layout(
        input=picture_input(facts, colour="bgr", placement="stretched"),
        output=Anchors(tensors=tuple(t.name for t in by_stride), strides=_STRIDES, anchors=_COCO),
        nms_iou=0.4,
    )
    why = (f"maps of {values} values at strides 16 and 32: three boxes, three objectnesses and classes",)
    assumed = ("the anchors of its COCO model: one that was trained on other pictures has its own",)
    return [Proposal(name, layout, why, values - 15, assumed)]
