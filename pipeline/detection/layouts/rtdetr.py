"""RT-DETR, D-FINE, DEIM and RF-DETR: a set of boxes without duplicates, with and without sizes as input.

https://github.com/lyuwenyu/RT-DETR, https://github.com/Peterande/D-FINE, https://github.com/ShihuaHuang95/DEIM,
https://github.com/roboflow/rf-detr
"""

from __future__ import annotations

from pipeline.config.layout import Chosen, Layout, Pairs, SizeInput
from pipeline.detection.facts import Facts, is_float, is_whole
from pipeline.detection.layouts.damoyolo import boxes_and_scores
from pipeline.detection.layouts.proposal import IMAGENET_MEAN, IMAGENET_STD, Proposal, picture_input

name = "rtdetr"
_MOST_QUERIES = 1000
#: COCO's 91 numbers and nobody
_DETR_CLASSES = 92
#: what RF-DETR's own export calls boxes and class values; others tell nothing
_RFDETR_NAMES = ("dets", "labels")


def propose(facts: Facts) -> list[Proposal]:
    """labels, boxes, scores in the size that is given; or logits and boxes in shares of the picture."""
    if facts.axes != "nchw":
        return []
    return [*_with_sizes(facts), *_without(facts)]


def _with_sizes(facts: Facts) -> list[Proposal]:
    if len(facts.others) != 1 or facts.others[0].shape[-1:] != (2,) or len(facts.outputs) != 3:
        return []
    boxes = [t for t in facts.outputs if t.shape[-1:] == (4,) and is_float(t) and len(t.shape) >= 2]
    labels = [t for t in facts.outputs if is_whole(t)]
    scores = [t for t in facts.outputs if is_float(t) and t not in boxes]
    if not (len(boxes) == len(labels) == len(scores) == 1):
        return []
    output = Chosen(boxes=boxes[0].name, scores=scores[0].name, labels=labels[0].name)
    sizes = (SizeInput(tensor=facts.others[0].name, value="width_height"),)
    why = ("labels, boxes and scores, and the size that boxes are given in as input",)
    plain = Layout(
        input=picture_input(facts, placement="stretched", filter="triangle"), sizes=sizes, output=output
    )
    normalised = Layout(input=_imagenet(facts), sizes=sizes, output=output)
    assumed = ("the picture without mean and std; DEIMv2 on DINOv3 takes ImageNet's",)
    return [
        Proposal("rtdetr_with_sizes", plain, why, None, assumed),
        Proposal("deimv2_dinov3", normalised, why, None, usual=False),
    ]


def _without(facts: Facts) -> list[Proposal]:
    found = None if facts.others else boxes_and_scores(facts, None)
    if found is None or not isinstance(found[0].shape[0], int) or found[0].shape[0] > _MOST_QUERIES:
        return []
    boxes, scores = found
    if boxes.shape[0] == facts.cells(8, 16, 32) or len(scores.shape) != 2:
        return []
    classes = int(scores.shape[1] or 0)
    why = [f"{boxes.shape[0]} queries of boxes and {classes} class values"]
    # the two differ in the picture alone, which only names or the trial picture can tell
    is_rfdetr = (boxes.name, scores.name) == _RFDETR_NAMES
    if is_rfdetr:
        why.append("its outputs have the names that RF-DETR's export gives them")
    pairs = {"boxes": boxes.name, "scores": scores.name, "box": "cxcywh", "unit": "shares"}
    sigmoid = Pairs.model_validate({**pairs, "activation": "sigmoid"})
    plain = Layout(input=picture_input(facts, placement="stretched", filter="triangle"), output=sigmoid)
    return [
        Proposal("rtdetr", plain, tuple(why), classes, usual=not is_rfdetr),
        Proposal("rfdetr", Layout(input=_imagenet(facts), output=sigmoid), tuple(why), classes),
        Proposal(
            "detr",
            Layout(input=_imagenet(facts), output=Pairs.model_validate({**pairs, "activation": "softmax"})),
            (*why, "the last class being nobody"),
            classes - 1,
            usual=classes == _DETR_CLASSES and not is_rfdetr,
        ),
    ]


def _imagenet(facts: Facts):  # type: ignore[no-untyped-def]
    return picture_input(
        facts, mean=IMAGENET_MEAN, std=IMAGENET_STD, placement="stretched", filter="triangle"
    )
