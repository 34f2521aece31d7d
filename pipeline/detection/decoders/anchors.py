"""``kind: anchors``: YOLO-FastestV2 (https://github.com/dog-qiuqiu/Yolo-FastestV2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.config.layout import Anchors
from pipeline.detection.decoders.candidates import Candidates, Groups, Outputs, corners, grid, of_dense
from pipeline.messages import FloatArray


def decode_anchors(
    outputs: Outputs, size: tuple[int, int], layout: Anchors, groups: Groups, least: float
) -> Candidates:
    """See decode. The classes of a cell are those of all its anchors."""
    classes, certain, boxes = [], [], []
    for name, stride, anchors in zip(layout.tensors, layout.strides, layout.anchors, strict=True):
        values = outputs[name]
        values = values.reshape(-1, values.shape[-1])
        count = len(anchors)
        cells, _ = grid(*size, (stride,))
        for number, anchor in enumerate(anchors):
            part = values[:, 4 * number : 4 * number + 4].astype(np.float64)
            centre = (part[:, :2] * 2.0 - 0.5 + cells) * stride
            boxes.append(np.concatenate([centre, (part[:, 2:] * 2.0) ** 2 * anchor], axis=1))
            certain.append(values[:, 4 * count + number].astype(np.float64))
            classes.append(values[:, 5 * count :].T)
    every, sure, all_boxes = np.concatenate(classes, axis=1), np.concatenate(certain), np.concatenate(boxes)

    def score_of(best: FloatArray, place: NDArray[np.int64]) -> FloatArray:
        return best * sure[place]

    return of_dense(every, groups, least, lambda place: corners(all_boxes[place], "cxcywh"), score_of)
