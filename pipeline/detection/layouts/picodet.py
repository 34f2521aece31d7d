"""PicoDet and PP-YOLOE of PaddleDetection (https://github.com/PaddlePaddle/PaddleDetection)."""

from __future__ import annotations

from pipeline.config.layout import Chosen, Distances, Layout, SizeInput
from pipeline.detection.facts import Facts, Tensor, is_float, is_whole
from pipeline.detection.layouts.nanodet import pairs_per_stride
from pipeline.detection.layouts.proposal import IMAGENET_MEAN, IMAGENET_STD, Proposal, picture_input

name = "picodet"
_STRIDES = (8, 16, 32, 64)
_BINS = 8
_COLUMNS = ("class", "score", "x0", "y0", "x1", "y1")


def propose(facts: Facts) -> list[Proposal]:
    """Without its postprocessing: eight tensors; with it: rows of class, score and box, and their count."""
    return [*_raw(facts), *_chosen(facts)]


def _raw(facts: Facts) -> list[Proposal]:
    pairs = None if facts.others else pairs_per_stride(facts, _STRIDES, _BINS)
    if pairs is None:
        return []
    scores, distances, classes = pairs
    layout = Layout(
        input=picture_input(
            facts, mean=IMAGENET_MEAN, std=IMAGENET_STD, placement="stretched", filter="linear"
        ),
        output=Distances(scores=scores, distances=distances, strides=_STRIDES, bins=_BINS),
        nms_iou=0.5,
    )
    why = ("class scores and distributions of 8 bins at the strides 8, 16, 32, 64",)
    return [Proposal(name, layout, why, classes)]


def _chosen(facts: Facts) -> list[Proposal]:
    if not facts.others or not all(_pair(t) for t in facts.others) or len(facts.outputs) != 2:
        return []
    rows = [t for t in facts.outputs if t.shape[-1:] == (6,) and is_float(t)]
    counts = [t for t in facts.outputs if t.shape == (1,) and is_whole(t)]
    if len(rows) != 1 or len(counts) != 1:
        return []
    sizes = _sizes(facts.others)
    if sizes is None:
        return []
    output = Chosen(rows=rows[0].name, columns=_COLUMNS, count=counts[0].name)
    why = (
        "rows of class, score and box, their count, and a scale as input, as PaddleDetection exports them",
    )
    inputs: dict[str, dict[str, object]] = {
        "picodet_with_nms": {"mean": IMAGENET_MEAN, "std": IMAGENET_STD},
        "ppyoloe_with_nms": {},
    }
    return [
        Proposal(
            which,
            Layout(input=picture_input(facts, placement="stretched", **how), sizes=sizes, output=output),
            why,
            None,
        )
        for which, how in inputs.items()
    ]


def _pair(tensor: Tensor) -> bool:
    return tensor.shape[-1:] == (2,) and is_float(tensor)


def _sizes(others: tuple[Tensor, ...]) -> tuple[SizeInput, ...] | None:
    """scale_factor, and before it im_shape if there are two; their names do not matter where there is one."""
    if len(others) == 1:
        return (SizeInput(tensor=others[0].name, value="ones"),)
    scales = [t for t in others if "scale" in t.name]
    if len(others) != 2 or len(scales) != 1:
        return None
    return tuple(SizeInput(tensor=t.name, value="ones" if t is scales[0] else "height_width") for t in others)
