"""Sizes of boxes against sizes of people: what is wrong with the height or the focal length shows in flight.

A box of a person at a place of the map is as large as a person there should be. If heights are too great by a factor,
or the focal length too short by it, all boxes are too large by it. The boxes alone cannot tell these two apart.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from pipeline.ingest.finding import Finding

#: bins per unit of the logarithm: 2 % each
BINS = 50
#: fewer boxes say nothing
_LEAST_BOXES = 40
#: the median of right telemetry, as the shipped detectors box people of 8 to 30 pixels: a box has a margin
_USUAL = 1.33
#: beyond these times the usual it is not right. The upper one is passed by one right stream in a
#: thousand (Student's t over the development flights, docs/checks.md); people who sit or are half hidden need a
#: wider lower one
_LEAST, _MOST = 0.45, 1.45


def size_bin(measured_px: float, expected_px: float) -> int:
    """The bin of a ratio of two lengths, both above 0."""
    return round(BINS * math.log(measured_px / expected_px))


def check_box_sizes(where: str, bins: Mapping[int, int]) -> list[Finding]:
    """At most one finding. bins: ``size_bin`` of each sure box of a person -> how many boxes."""
    boxes = sum(bins.values())
    if boxes < _LEAST_BOXES:
        return []
    values = sorted(bins)
    share = np.cumsum([bins[v] for v in values]) / boxes
    low, factor, high = (
        math.exp(values[int(np.searchsorted(share, q - 1e-9))] / BINS) / _USUAL for q in (0.25, 0.5, 0.75)
    )
    if _LEAST <= factor <= _MOST:
        return []
    found = f"boxes of people are {factor:.2f} times as large as they should be at their places"
    evidence = f"the median of {boxes} sure boxes; half of them lie between {low:.2f} and {high:.2f}"
    mend = f"heights above the ground {1.0 / factor:.2f} times as great, or a focal length {factor:.2f} times as long"
    return [Finding("warning", "height_off/focal_length", where, found, evidence, mend)]
