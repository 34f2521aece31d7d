"""NanoDet and NanoDet-Plus (https://github.com/RangiLyu/nanodet)."""

from __future__ import annotations

from pipeline.config.layout import Distances, Layout
from pipeline.detection.facts import Facts, Tensor
from pipeline.detection.layouts.proposal import Proposal, picture_input

name = "nanodet"
_BINS = 8
_MEAN_BGR, _STD_BGR = (103.53, 116.28, 123.675), (57.375, 57.12, 58.395)


def propose(facts: Facts) -> list[Proposal]:
    """Class scores and distributions of distances, apart (NanoDet) or beside each other (NanoDet-Plus)."""
    if facts.others:
        return []
    return [*_apart(facts), *_beside(facts)]


def _apart(facts: Facts) -> list[Proposal]:
    strides = (8, 16, 32)
    pairs = pairs_per_stride(facts, strides, _BINS)
    if pairs is None:
        return []
    scores, distances, classes = pairs
    layout = Layout(
        input=_input(facts, "letterbox_centred"),
        output=Distances(scores=scores, distances=distances, strides=strides, bins=_BINS),
        nms_iou=0.6,
    )
    why = ("class scores and distributions of 8 bins at the strides 8, 16, 32",)
    return [Proposal(name, layout, why, classes)]


def _beside(facts: Facts) -> list[Proposal]:
    if len(facts.outputs) != 1 or len(facts.outputs[0].shape) != 2:
        return []
    (output,) = facts.outputs
    for strides, which in (((8, 16, 32, 64), "nanodet_plus"), ((8, 16, 32), "nanodet_m_one_output")):
        places, values = output.shape
        if places == facts.cells(*strides) and isinstance(values, int) and values > 4 * _BINS:
            plus = len(strides) == 4
            layout = Layout(
                input=_input(facts, "stretched" if plus else "letterbox_centred"),
                output=Distances(
                    tensor=output.name, strides=strides, bins=_BINS, centre=0.0 if plus else 0.5
                ),
                nms_iou=0.6,
            )
            why = (
                f"{places} candidates are one for each cell of the strides {strides}",
                f"{values} values are {values - 4 * _BINS} classes and four distributions of 8 bins",
            )
            return [Proposal(which, layout, why, values - 4 * _BINS, usual=plus, grid=strides)]
    return []


def _input(facts: Facts, placement: str):  # type: ignore[no-untyped-def]
    return picture_input(
        facts,
        colour="bgr",
        range=255.0,
        mean=_MEAN_BGR,
        std=_STD_BGR,
        placement=placement,
        fill=0,
        filter="area",
    )


def pairs_per_stride(
    facts: Facts, strides: tuple[int, ...], bins: int
) -> tuple[tuple[str, ...], tuple[str, ...], int] | None:
    """Names of the tensors of scores and of distributions by rising stride, and the classes.

    None if the outputs are not just these. In networks with 4 x bins classes their order tells them apart.
    """
    if len(facts.outputs) != 2 * len(strides):
        return None
    scores, distances, classes = [], [], set()
    for stride in strides:
        here = [t for t in facts.outputs if len(t.shape) == 2 and t.shape[0] == facts.cells(stride)]
        if len(here) != 2:
            return None
        spread = [t for t in here if t.shape[1] == 4 * bins]
        if not spread:
            return None
        distance = spread[-1]
        (score,) = (t for t in here if t is not distance)
        scores.append(score)
        distances.append(distance)
        classes.add(score.shape[1])
    (count, *more) = classes
    if more or not isinstance(count, int):
        return None
    return _names(scores), _names(distances), count


def _names(tensors: list[Tensor]) -> tuple[str, ...]:
    return tuple(t.name for t in tensors)
