"""What one substream is worth: the detector as it really runs, at its bitrate, under its codec.

A network that finds nine people of ten at 4 Mbps finds one of ten at 50 kbps, and more of its boxes are wrong. So
what raises and lowers the map is taken at the bitrate of the assignment:

- A score is worth what it was worth at that bitrate (``calibration_at``), where the pool knows it. Then the paper's
  p_det^rel is that of the detector at its best: what the bitrate takes is in the calibrated score already. Where
  the pool does not know it, p_det^rel is that of the bitrate.
- A look that found nothing lowers by the probability that somebody there would have been found: the share of
  people of that size whom the detector found at that bitrate, where the pool knows it (``probability_found``).
  Else by the paper's rule, with the p_det^rel of the bitrate.

Between two bitrates that were measured all is linear in the logarithm of the bitrate, and level beyond them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config.pool import Calibration, OperatingPoint, PoolDetector
from pipeline.link.codec import Codec
from pipeline.messages import FloatArray
from pipeline.sensor.accuracy import accuracy_at
from pipeline.sensor.setup import Setup

#: smaller people, pixels of a network, nobody finds: one cell of the finest usual feature map
_LEAST_PX = 4.0


@dataclass(frozen=True)
class SubstreamModel:
    """raises, lowers: the paper's p_det^rel of the positive and of the negative update, 0..1.

    sizes_px, found: the share of people of a size (root of the box's area) who are found in one picture; empty
    where the pool does not know it. picture_width: of the pictures whose pixels sizes_px are in; 0: the stream's
    own, for a detector that looks at tiles. trust: how far its calibrated scores hold there, 0..1: wholly where they
    were calibrated at the bitrate, else by what the bitrate leaves of the detector's accuracy.
    """

    raises: float
    lowers: float
    sizes_px: tuple[float, ...] = ()
    found: tuple[float, ...] = ()
    picture_width: int = 0
    trust: float = 1.0

    def probability_found(self, person_px: FloatArray, picture_width: int) -> FloatArray | None:
        """Absolute, of people so large (N,), in pixels of a picture of this width; None if it is not known."""
        if not self.sizes_px:
            return None
        scale = self.picture_width / picture_width if self.picture_width else 1.0
        size = np.maximum(np.asarray(person_px, dtype=np.float64) * scale, 1e-9)
        return np.interp(np.log(size), np.log(self.sizes_px), self.found)


def substream_model(
    detector: PoolDetector, codec: Codec, bitrate_bps: float, best_accuracy: float, setup: Setup
) -> SubstreamModel:
    """best_accuracy: of the whole pool, which p_det^rel is relative to."""
    own = detector.best_accuracy
    there = _accuracy_there(detector, codec, bitrate_bps)
    points = _points(detector, codec)
    calibrated = any(point.calibration for point in points)
    sizes, found = _found_at(points, bitrate_bps)
    width = 0 if setup.tiling is not None or not points else points[0].picture_width
    raises = own if calibrated else there
    return SubstreamModel(
        raises=min(1.0, raises / best_accuracy),
        lowers=min(1.0, there / best_accuracy),
        sizes_px=sizes,
        found=found,
        picture_width=width,
        trust=1.0 if calibrated or own == 0.0 else min(1.0, there / own),
    )


def calibration_at(detector: PoolDetector, codec: Codec, bitrate_bps: float) -> Calibration | None:
    """What its scores are worth there; what the pool says of all conditions together where it says no more."""
    rows = [(point.bitrate, point.calibration) for point in _points(detector, codec) if point.calibration]
    if not rows:
        return detector.calibration
    at = np.log([bitrate for bitrate, _ in rows])
    scale, offset = (
        float(np.interp(math.log(bitrate_bps), at, [getattr(c, name) for _, c in rows]))
        for name in ("scale", "offset")
    )
    return Calibration(scale=scale, offset=offset)


def as_sent(detector: PoolDetector, codec: Codec, bitrate_bps: float) -> PoolDetector:
    """The row of the pool with the calibration of what it is sent."""
    return detector.model_copy(update={"calibration": calibration_at(detector, codec, bitrate_bps)})


def _points(detector: PoolDetector, codec: Codec) -> list[OperatingPoint]:
    return sorted((p for p in detector.operating_points if p.codec == codec), key=lambda p: p.bitrate)


def _accuracy_there(detector: PoolDetector, codec: Codec, bitrate_bps: float) -> float:
    of_codec = tuple(row for row in detector.accuracy_by_codec if row.codec == codec)
    return accuracy_at(of_codec or detector.accuracy, bitrate_bps)


def _found_at(
    points: list[OperatingPoint], bitrate_bps: float
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Sizes and shares at a bitrate, from those sizes that were measured at every bitrate; none if there are none."""
    if not points:
        return (), ()
    shares = [
        {_middle(row.person_px_from, row.person_px_below): row.share for row in p.found} for p in points
    ]
    sizes = sorted(set.intersection(*(set(share) for share in shares)))
    if not sizes:
        return (), ()
    at = np.log([point.bitrate for point in points])
    found = [float(np.interp(math.log(bitrate_bps), at, [share[px] for share in shares])) for px in sizes]
    return (_LEAST_PX, *sizes), (0.0, *found)


def _middle(low_px: float, below_px: float | None) -> float:
    """Of a class of sizes: the geometric mean of its ends; of an open one, its known end."""
    low = max(low_px, _LEAST_PX)
    return low if below_px is None else math.sqrt(low * below_px)


def found_by_distance(
    model: SubstreamModel, person_px_m: float, picture_width: int, distances_m: FloatArray
) -> NDArray[np.float64] | None:
    """The probability (N,) that somebody at these distances is found; None if it is not known.

    person_px_m: pixels of the root of a typical person's box times metres.
    """
    return model.probability_found(person_px_m / np.maximum(distances_m, 1e-6), picture_width)
