"""One picture as every codec leaves it at the lowest bitrate, and what a detector finds in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.detection import load_detector
from pipeline.evaluation.datasets.dataset import DataSet, scaled
from pipeline.evaluation.measuring.grid import Grid
from pipeline.evaluation.measuring.unit import Model, Unit
from pipeline.evaluation.measuring.work_unit import first_pictures
from pipeline.link.codec import Codec
from pipeline.messages import FloatArray

#: not in the first seconds, where the encoder still looks for its rate, nor so late that it takes long
_EARLIEST_S, _LATEST_S = 2.0, 10.0


@dataclass(frozen=True, eq=False)
class Example:
    """codec None: as filmed. image: uint8 (H, W, 3). true_px, found_px: float64 (N, 4) xyxy."""

    codec: Codec | None
    bitrate_bps: float | None
    image: NDArray[np.uint8]
    true_px: FloatArray
    found_px: FloatArray


def examples(grid: Grid, dataset: DataSet, model: Model, score_threshold: float) -> list[Example]:
    """The picture with most people among the early ones of all sequences: as it is, then by codec."""
    lowest = {c.codec: c for c in sorted(grid.conditions, key=lambda c: -(c.bitrate_bps or 0.0))}
    name, frame = _chosen(grid, dataset)
    units = [u for c in lowest.values() for u in grid.units if u.sequence == name and u.condition == c]
    detector = load_detector(model.path, score_threshold=score_threshold, provider=model.provider)
    found = []
    for unit in units:
        until = tuple(k for k in unit.kept if k <= frame)
        (image,) = first_pictures(replace(unit, kept=until, looked={frame: unit.looked[frame]}, models=()), 1)
        boxes, _, _ = detector.detect(image)
        true = _true_boxes(dataset, unit, unit.looked[frame])
        found.append(Example(unit.condition.codec, unit.condition.bitrate_bps, image, true, boxes))
    return sorted(found, key=lambda e: e.codec is not None)


def _chosen(grid: Grid, dataset: DataSet) -> tuple[str, int]:
    """Sequence and frame."""
    people = np.bincount(dataset.truth.image[~dataset.truth.crowd], minlength=len(dataset.pictures))
    frames = [(u, f) for u in grid.units if u.condition.codec is None for f in u.looked]
    early = [(u, f) for u, f in frames if _EARLIEST_S <= f / u.frame_rate_hz <= _LATEST_S] or frames
    unit, frame = max(early, key=lambda pair: (int(people[pair[0].looked[pair[1]]]), -pair[1]))
    return unit.sequence, frame


def _true_boxes(dataset: DataSet, unit: Unit, picture: int) -> FloatArray:
    truth, _ = scaled(dataset.truth, dataset.pictures, unit.size)
    xywh = truth.bbox[(truth.image == picture) & ~truth.crowd]
    return np.hstack([xywh[:, :2], xywh[:, :2] + xywh[:, 2:]])
