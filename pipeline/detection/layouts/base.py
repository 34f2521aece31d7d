"""What every output layout does: prepare the inputs, decode the outputs."""

from __future__ import annotations

from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.detection.placement import Placement
from pipeline.detection.session import Signature
from pipeline.messages import FloatArray


class Layout(Protocol):
    """The pre- and post-processing of one family of networks.

    name: as users read it. nms_iou: boxes that overlap more are one person; 1: the network does that.
    """

    name: ClassVar[str]
    nms_iou: ClassVar[float]

    @classmethod
    def recognise(cls, signature: Signature) -> Self | None:
        """The layout of a model with this signature, None if it is another's."""

    def prepare(self, image: NDArray[np.uint8]) -> tuple[dict[str, NDArray[Any]], Placement]:
        """The model's inputs for a picture (H, W, 3) RGB, and where in them the picture is."""

    def decode(self, outputs: list[NDArray[np.float32]]) -> tuple[FloatArray, FloatArray]:
        """Of all candidates for a person: boxes (N, 4) xyxy in pixels of the input, and scores (N,)."""


def planar(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """The picture (H, W, 3) as float32 (1, 3, H, W), values unchanged."""
    return np.ascontiguousarray(image.transpose(2, 0, 1)[None], np.float32)


def grid_corners(width: int, height: int, strides: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """Of all cells of the given strides, row by row: column and row (N, 2), and stride (N, 1)."""
    cells, sizes = [], []
    for stride in strides:
        y, x = np.mgrid[: height // stride, : width // stride]
        cells.append(np.stack([x.ravel(), y.ravel()], axis=1).astype(float))
        sizes.append(np.full((x.size, 1), float(stride)))
    return np.concatenate(cells), np.concatenate(sizes)


def boxes_around(centres: FloatArray, sizes: FloatArray) -> FloatArray:
    """Boxes (N, 4) xyxy of centres (N, 2) and widths and heights (N, 2)."""
    return np.concatenate([centres - sizes / 2, centres + sizes / 2], axis=1)
