"""The ``layout:`` of a detector in a pool: what a network takes and how its outputs are read.

Every built-in layout is such a description too; a network that none of them fits is described here, without
code.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pipeline.config.base import Strict, mismatch

Axes = Literal["nchw", "nhwc", "chw", "hwc"]
Colour = Literal["rgb", "bgr", "grey"]
Placing = Literal["letterbox_centred", "letterbox_top_left", "stretched"]
BoxForm = Literal["cxcywh", "xyxy", "xywh", "yxyx"]
Unit = Literal["pixels", "shares"]
Activation = Literal["none", "sigmoid", "softmax"]
Column = Literal["x0", "y0", "x1", "y1", "cx", "cy", "w", "h", "score", "class", "picture"]
Side = Annotated[int, Field(ge=1, le=16384)]
Strides = Annotated[tuple[Annotated[int, Field(ge=1, le=1024)], ...], Field(min_length=1)]
_BOX_COLUMNS = ({"x0", "y0", "x1", "y1"}, {"cx", "cy", "w", "h"}, {"x0", "y0", "w", "h"})


class PictureInput(Strict):
    """The picture as the network takes it: (value / 255 * range - mean) / std.

    tensor: its name. size: width and height, where the model leaves them free; ``picture``: as it comes.
    range: the greatest value before mean and std, which are in the order of colour. fill: 0 .. 255, beside a
    letterboxed picture. filter: how it is made smaller (area: the mean, linear: OpenCV's, triangle: Pillow's).
    """

    tensor: str
    axes: Axes = "nchw"
    size: tuple[Side, Side] | Literal["picture"] | None = None
    colour: Colour = "rgb"
    range: float = Field(default=1.0, gt=0.0)
    mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    std: tuple[Annotated[float, Field(gt=0.0)], ...] = (1.0, 1.0, 1.0)
    placement: Placing = "letterbox_centred"
    fill: int = Field(default=114, ge=0, le=255)
    filter: Literal["area", "linear", "triangle"] = "linear"

    @model_validator(mode="after")
    def _as_many_as_colours(self) -> PictureInput:
        for name in ("mean", "std"):
            found = len(getattr(self, name))
            if found != 3:
                raise mismatch(f"{found} numbers", "three, in the order of colour", (name,))
        return self


class SizeInput(Strict):
    """A second input. value: the network's own width and height, or ones (a scale of 1)."""

    tensor: str
    value: Literal["width_height", "height_width", "ones"]


class Rows(Strict):
    """One tensor; each candidate is a row of box, objectness if any, and a score for each class.

    order: ``rows``: (candidates, values), ``columns``: (values, candidates). unit: of boxes: pixels of the
    input, or shares of its size. grid: ``yolox``: offsets and log sizes in cells of the strides.
    """

    kind: Literal["rows"] = "rows"
    tensor: str
    order: Literal["rows", "columns"] = "rows"
    box: BoxForm = "cxcywh"
    unit: Unit = "pixels"
    objectness: bool = False
    activation: Activation = "none"
    grid: Literal["none", "yolox"] = "none"
    strides: Strides = (8, 16, 32)


class Pairs(Strict):
    """Boxes (candidates, 4) and scores (candidates, classes), or (candidates,) for one class.

    scores_order: ``columns``: (classes, candidates). selected: rows of (picture, class, candidate), what
    ONNX's NonMaxSuppression gives. With softmax the last class is nobody.
    """

    kind: Literal["pairs"] = "pairs"
    boxes: str
    scores: str
    scores_order: Literal["rows", "columns"] = "rows"
    box: BoxForm = "xyxy"
    unit: Unit = "pixels"
    activation: Activation = "none"
    selected: str | None = None


class Chosen(Strict):
    """What is left after the network has chosen: one row for each object, or one tensor for each part.

    rows, columns: one tensor and what its columns are. Or boxes, scores, labels. count: how many are valid.
    """

    kind: Literal["chosen"] = "chosen"
    rows: str | None = None
    columns: tuple[Column, ...] = ()
    boxes: str | None = None
    scores: str | None = None
    labels: str | None = None
    count: str | None = None
    box: BoxForm = "xyxy"
    unit: Unit = "pixels"

    @model_validator(mode="after")
    def _one_of_both(self) -> Chosen:
        if self.rows is None and (self.boxes is None or (self.scores is None and not self.columns)):
            raise mismatch("neither rows nor boxes and scores", "one of both")
        if self.rows is not None or self.columns:
            named = set(self.columns)
            if "score" not in named or not any(box <= named for box in _BOX_COLUMNS):
                raise mismatch(
                    f"columns {list(self.columns)}", "x0, y0, x1, y1 or cx, cy, w, h; score", ("columns",)
                )
            if len(named) != len(self.columns):
                raise mismatch("a column twice", "each column once", ("columns",))
        return self


class Distances(Strict):
    """Class scores and distributions of the distances to the four edges, at several strides.

    scores, distances: a tensor each per stride; or tensor: both beside each other, strides one after the
    other. bins: of each distribution. centre: of a cell, from its corner, in cells.
    """

    kind: Literal["distances"] = "distances"
    tensor: str | None = None
    scores: tuple[str, ...] = ()
    distances: tuple[str, ...] = ()
    strides: Strides = (8, 16, 32)
    bins: int = Field(default=8, ge=2, le=64)
    centre: float = 0.5
    activation: Literal["none", "sigmoid"] = "none"

    @model_validator(mode="after")
    def _complete(self) -> Distances:
        if self.tensor is None and not len(self.scores) == len(self.distances) == len(self.strides):
            raise mismatch(
                f"{len(self.scores)} tensors of scores and {len(self.distances)} of distances",
                f"one each per stride, {len(self.strides)}",
            )
        return self


class Anchors(Strict):
    """YOLO-FastestV2: per stride a map (rows, columns, 4 x anchors + anchors + classes), values in 0..1.

    anchors: width and height of each in pixels of the input, for each stride.
    """

    kind: Literal["anchors"] = "anchors"
    tensors: tuple[str, ...] = Field(min_length=1)
    strides: Strides = (16, 32)
    anchors: tuple[tuple[tuple[float, float], ...], ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _as_many_as_strides(self) -> Anchors:
        if not len(self.tensors) == len(self.strides) == len(self.anchors):
            found = f"{len(self.tensors)} tensors, {len(self.strides)} strides, {len(self.anchors)} rows of anchors"
            raise mismatch(found, "as many of each")
        return self


class Cells(Strict):
    """FastestDet: one map (5 + classes, rows, columns): objectness, tanh offset, sigmoid size, classes.

    score = objectness^0.6 * class^0.4.
    """

    kind: Literal["cells"] = "cells"
    tensor: str
    stride: int = Field(default=16, ge=1, le=1024)


Output = Annotated[Rows | Pairs | Chosen | Distances | Anchors | Cells, Field(discriminator="kind")]


class Layout(Strict):
    """What a network takes and gives. nms_iou: boxes that overlap more are one; absent: the network did that.

    first_class: the number of the first of ``names``: 1 where 0 is the background.
    """

    input: PictureInput
    sizes: tuple[SizeInput, ...] = ()
    output: Output
    nms_iou: float | None = Field(default=None, ge=0.0, le=1.0)
    first_class: int = Field(default=0, ge=0, le=1000)
