"""What a layout says of a model that it may be the layout of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from pipeline.config.layout import Layout, PictureInput
from pipeline.detection.facts import Facts

#: of ImageNet, red, green, blue, for values in 0..1
IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


@dataclass(frozen=True, slots=True)
class Proposal:
    """One way to read a model.

    name: of the layout. why: what speaks for it. classes: how many the network tells apart; None: its outputs
    do not show it. assumed: what neither shapes nor values can show. usual: False where it is only taken if
    the trial picture speaks for it. grid: strides whose cells, row by row, are the candidates, times anchors.
    """

    name: str
    layout: Layout
    why: tuple[str, ...]
    classes: int | None
    assumed: tuple[str, ...] = ()
    usual: bool = True
    grid: tuple[int, ...] = ()
    anchors: int = 1


class LayoutFamily(Protocol):
    """One file of ``layouts/``, or what a user's package offers as ``searchlight.detector_layouts``."""

    name: str

    def propose(self, facts: Facts) -> Sequence[Proposal]:
        """The ways in which this may be the layout of a model; none if it is not.

        Raises InputError for a model that is surely of this family and cannot be used.
        """


def picture_input(facts: Facts, **how: object) -> PictureInput:
    """The section for the picture, with what the model fixes filled in."""
    fixed = all(isinstance(size, int) for size in _sides(facts))
    size = None if fixed else ("picture" if facts.size is None else facts.size)
    if facts.picture.dtype == "uint8":
        # whole numbers leave no room for fractions: the graph scales them
        how = {key: value for key, value in how.items() if key not in ("mean", "std")} | {"range": 255.0}
    return PictureInput.model_validate(
        {"tensor": facts.picture.name, "axes": facts.axes, "size": size} | how, strict=False
    )


def _sides(facts: Facts) -> tuple[object, ...]:
    shape = facts.picture.shape
    return shape[-2:] if facts.axes.endswith("chw") else shape[-3:-1]
