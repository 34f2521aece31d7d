"""What the network should say, and how wrong it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

#: a person's heat falls to exp(-1/2) at this share of the box from its centre (TTFNet, arXiv:1909.00700)
_SIGMA_SHARE = 0.18
_SIGMA_MIN_CELLS = 0.6
#: cells with at least this heat also learn the box
_BOX_HEAT = 0.3


@dataclass(frozen=True, slots=True)
class Targets:
    """Of a batch, on the network's grid (h, w).

    heat (B, h, w): 1 at the cell of a person's centre, falling to 0 around it. boxes (B, 4, h, w): xyxy in
    input pixels where box_weight > 0. box_weight (B, h, w). care (B, h, w): 0 or 1, 0: not learned.
    """

    heat: Tensor
    boxes: Tensor
    box_weight: Tensor
    care: Tensor

    @classmethod
    def of(
        cls,
        people: list[NDArray[Any]],
        ignored: list[NDArray[Any]],
        height: int,
        width: int,
        stride: int,
    ) -> Targets:
        """people, ignored: per picture boxes (N, 4) xyxy in pixels of an input of height x width."""
        grids = [
            _grids(p, i, height // stride, width // stride, stride)
            for p, i in zip(people, ignored, strict=True)
        ]
        heat, boxes, weight, care = (torch.from_numpy(np.stack(parts)) for parts in zip(*grids, strict=True))
        return cls(heat, boxes, weight, care)


def _grids(
    people: NDArray[Any], ignored: NDArray[Any], rows: int, columns: int, stride: int
) -> tuple[NDArray[Any], ...]:
    heat = np.zeros((rows, columns), np.float32)
    boxes = np.zeros((4, rows, columns), np.float32)
    care = np.ones((rows, columns), np.float32)
    for box in ignored / stride:
        x0, y0, x1, y1 = np.floor(box - [1, 1, -2, -2]).astype(int)
        care[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)] = 0.0
    for box in people:
        own = _heat(box / stride, rows, columns)
        boxes[:, own > heat] = box[:, None]
        heat = np.maximum(heat, own)
    care[heat > 0.0] = 1.0
    return heat, boxes, np.where(heat >= _BOX_HEAT, heat, 0.0).astype(np.float32), care


def _heat(box: NDArray[Any], rows: int, columns: int) -> NDArray[np.float32]:
    """A Gaussian (rows, columns) as wide as the box, peak 1 at the cell of its centre; nothing below 1 %."""
    centre = np.minimum((box[:2] + box[2:]) / 2, [columns - 1e-3, rows - 1e-3])
    peak = np.floor(np.maximum(centre, 0.0))
    sigma = np.maximum(_SIGMA_SHARE * (box[2:] - box[:2]), _SIGMA_MIN_CELLS)
    x = ((np.arange(columns) - peak[0]) / sigma[0]) ** 2
    y = ((np.arange(rows) - peak[1]) / sigma[1]) ** 2
    heat = np.exp(-0.5 * (y[:, None] + x)).astype(np.float32)
    return np.where(heat < 0.01, np.float32(0.0), heat)


def heat_loss(logits: Tensor, targets: Targets) -> Tensor:
    """The penalty-reduced focal loss of CenterNet (arXiv:1904.07850, equation 1), per person."""
    score = logits.sigmoid()
    centre = (targets.heat == 1.0).to(score.dtype)
    hit = centre * (1.0 - score) ** 2 * functional.logsigmoid(logits)
    miss = (1.0 - centre) * (1.0 - targets.heat) ** 4 * score**2 * functional.logsigmoid(-logits)
    return -((hit + miss) * targets.care).sum() / centre.sum().clamp(min=1.0)


def box_loss(boxes: Tensor, targets: Targets) -> Tensor:
    """2 (1 - GIoU) (arXiv:1902.09630) plus the edges' error in shares of the box, weighted by the heat."""
    chosen = targets.box_weight > 0.0
    weight = targets.box_weight[chosen]
    found, true = boxes.permute(0, 2, 3, 1)[chosen], targets.boxes.permute(0, 2, 3, 1)[chosen]
    size = (true[:, 2:] - true[:, :2]).repeat(1, 2)
    edges = functional.smooth_l1_loss(found / size, true / size, beta=0.1, reduction="none").sum(dim=1)
    return (weight * (2.0 * (1.0 - generalized_iou(found, true)) + edges)).sum() / weight.sum().clamp(min=1.0)


def generalized_iou(a: Tensor, b: Tensor) -> Tensor:
    """GIoU (N,) in -1..1 of boxes (N, 4) with boxes (N, 4), xyxy, widths and heights above 0."""
    overlap = (
        (torch.minimum(a[:, 2:], b[:, 2:]) - torch.maximum(a[:, :2], b[:, :2])).clamp(min=0.0).prod(dim=1)
    )
    hull = (torch.maximum(a[:, 2:], b[:, 2:]) - torch.minimum(a[:, :2], b[:, :2])).prod(dim=1)
    union = (a[:, 2:] - a[:, :2]).prod(dim=1) + (b[:, 2:] - b[:, :2]).prod(dim=1) - overlap
    return overlap / union - (hull - union) / hull
