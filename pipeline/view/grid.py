"""Lines of latitude and longitude over a part of the map frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pipeline.geo.frame import LocalFrame

_MOST_LINES = 8
Bounds = tuple[float, float, float, float]


def grid(frame: LocalFrame, bounds: Bounds) -> list[dict[str, Any]]:
    """Each with its label and points (east, north). bounds: west, south, east, north, metres."""
    west, south, east, north = bounds
    corners = np.array([[west, south], [east, south], [east, north], [west, north]])
    latitude, longitude = frame.wgs84_from_enu(corners[:, 0], corners[:, 1])
    lows, highs = (latitude.min(), longitude.min()), (latitude.max(), longitude.max())
    lines = []
    for axis, letters in ((0, "NS"), (1, "EW")):
        step, decimals = _step(highs[axis] - lows[axis])
        first = math.ceil(lows[axis] / step)
        for k in range(first, math.floor(highs[axis] / step) + 1):
            value = k * step
            along = np.linspace(lows[1 - axis], highs[1 - axis], 5)
            fixed = np.full(5, value)
            e, n = frame.enu_from_wgs84(*((fixed, along) if axis == 0 else (along, fixed)))
            points = np.stack([e, n], axis=1).round(2).tolist()
            label = f"{abs(value):.{decimals}f}° {letters[0] if value >= 0 else letters[1]}"
            lines.append({"label": label, "axis": "latitude" if axis == 0 else "longitude", "points": points})
    return lines


def _step(span_deg: float) -> tuple[float, int]:
    """Degrees between two lines, 1, 2 or 5 times a power of ten, and the decimals of its labels."""
    for power in range(-7, 3):
        for factor in (1, 2, 5):
            step = factor * 10.0**power
            if span_deg / step <= _MOST_LINES:
                return step, max(0, -power)
    return 90.0, 0
