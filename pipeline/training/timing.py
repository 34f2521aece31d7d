"""How long a detector takes for a picture on this machine."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from pipeline.detection import Detector

_WARM_UP = 5


def median_time_s(detector: Detector, image: NDArray[np.uint8], repeats: int) -> float:
    """Median processor seconds from the pixels of a picture (H, W, 3) to boxes, warm-up left out.

    The detector must run on one thread, this one: processor time is what a machine of its own would take,
    whatever else runs here meanwhile.
    """
    taken = []
    for _ in range(_WARM_UP + repeats):
        started = time.thread_time()
        detector.detect(image)
        taken.append(time.thread_time() - started)
    return float(np.median(taken[_WARM_UP:]))
