"""What a detector's boxes above its threshold are worth under each condition: for the map."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from pydantic import BaseModel, ConfigDict

from pipeline.config.pool import Calibration
from pipeline.evaluation.measuring.grid_results import GridResults
from pipeline.evaluation.metrics.matching import Matches, match
from pipeline.link.codec import Codec
from pipeline.sensor.calibration import fit_calibration

_IOU = np.array([0.5])
#: sizes of people (root of the box's area, pixels) from .. to
SIZES_PX = (
    (0.0, 16.0),
    (16.0, 24.0),
    (24.0, 32.0),
    (32.0, 48.0),
    (48.0, 64.0),
    (64.0, 96.0),
    (96.0, math.inf),
)
#: a share of fewer people says next to nothing, nor does a calibration on fewer right or wrong boxes
_LEAST_PEOPLE, _LEAST_BOXES = 10, 20


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class FoundShare(_Record):
    """Of people from .. below pixels (None: no end) the share found, and how many they are."""

    person_px_from: float
    person_px_below: float | None
    share: float
    people: int


class MeasuredOperatingPoint(_Record):
    """See ``pipeline.config.pool.OperatingPoint``. right, wrong: boxes above the threshold."""

    codec: Codec
    bitrate_bps: float
    picture_width: int
    calibration: Calibration | None
    found: tuple[FoundShare, ...]
    false_boxes: float
    right: int
    wrong: int


def operating_points(
    results: GridResults, detector: str, threshold: float
) -> tuple[MeasuredOperatingPoint, ...]:
    """Of one detector, under every condition with a codec."""
    transcoding, points = results.evaluation.transcoding, []
    if transcoding is None:
        return ()
    for condition in results.grid.conditions:
        if condition.codec is None or condition.bitrate_bps is None:
            continue
        found = results.found(detector, condition)
        matches = match(results.sample.truth, found, "all", _IOU)
        counted = ~matches.ignored[0] & (matches.score >= threshold)
        right = matches.right[0, counted]
        enough = min(int(right.sum()), int((~right).sum())) >= _LEAST_BOXES
        points.append(
            MeasuredOperatingPoint(
                codec=condition.codec,
                bitrate_bps=condition.bitrate_bps,
                picture_width=transcoding.width,
                calibration=fit_calibration(matches.score[counted], right) if enough else None,
                found=tuple(_shares(results, detector, condition, threshold)),
                false_boxes=round(float((~right).sum()) / results.sample.images, 4),
                right=int(right.sum()),
                wrong=int((~right).sum()),
            )
        )
    return tuple(points)


def _shares(results: GridResults, detector: str, condition: object, threshold: float) -> Iterator[FoundShare]:
    found = results.found(detector, condition)  # type: ignore[arg-type]
    for low, below in SIZES_PX:
        matches = match(results.sample.truth, found, (low**2, below**2), _IOU)
        people = len(matches.true_image)
        if people >= _LEAST_PEOPLE:
            share = round(_found(matches, threshold) / people, 4)
            yield FoundShare(
                person_px_from=low,
                person_px_below=None if math.isinf(below) else below,
                share=share,
                people=people,
            )


def _found(matches: Matches, threshold: float) -> int:
    return int((matches.right[0] & (matches.score >= threshold)).sum())
