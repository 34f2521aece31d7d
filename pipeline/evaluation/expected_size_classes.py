"""The classes of expected size of a person, which accuracy depends on most; see ``geo.expected_size``."""

from __future__ import annotations

import math
from itertools import pairwise

#: edges of the classes of expected size, pixels; COCO's 32 and 96 are among them
CONTEXT_EDGES_PX = (0.0, 16.0, 24.0, 32.0, 48.0, 64.0, 96.0, math.inf)


def context_classes() -> tuple[tuple[float, float], ...]:
    """The classes of expected size: from, and below which, in pixels."""
    return tuple(pairwise(CONTEXT_EDGES_PX))
