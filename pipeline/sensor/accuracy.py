"""How accurate a detector is at a bitrate between those that were measured."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from pipeline.config.pool import AccuracyAt


def accuracy_at(points: Iterable[AccuracyAt], bitrate_bps: float) -> float:
    """Accuracy at a bitrate: linear in its logarithm between the pool's points, level beyond them."""
    ordered = sorted(points, key=lambda point: point.bitrate)
    return float(
        np.interp(
            math.log(bitrate_bps),
            [math.log(point.bitrate) for point in ordered],
            [point.accuracy for point in ordered],
        )
    )
