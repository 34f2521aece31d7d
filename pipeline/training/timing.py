"""What a detector costs on this machine: seconds per picture, and memory."""

from __future__ import annotations

import multiprocessing
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.detection import Detector, load_detector

_WARM_UP = 5


@dataclass(frozen=True, slots=True)
class Timing:
    """Processor seconds per picture from uint8 pixels to boxes. p99_s: 99 of 100 pictures take no longer."""

    mean_s: float
    median_s: float
    p99_s: float


def time_detector(detector: Detector, image: NDArray[np.uint8], repeats: int) -> Timing:
    """Time so many detections in a picture (H, W, 3), after a few that are not counted.

    The detector must run on one thread, this one: processor time is what a machine of its own would take,
    whatever else runs here meanwhile.
    """
    taken = []
    for _ in range(_WARM_UP + repeats):
        started = time.thread_time()
        detector.detect(image)
        taken.append(time.thread_time() - started)
    counted = np.array(taken[_WARM_UP:])
    return Timing(float(counted.mean()), float(np.median(counted)), float(np.quantile(counted, 0.99)))


def memory_of(model: Path, image_size: tuple[int, int]) -> int:
    """Bytes by which a fresh process grows when it opens the model and looks at pictures (width, height)."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_growth, model, image_size).result()


def _growth(model: Path, image_size: tuple[int, int]) -> int:
    image = np.zeros((image_size[1], image_size[0], 3), np.uint8)
    before = _resident_bytes()
    detector = load_detector(model, score_threshold=0.3)
    for _ in range(_WARM_UP):
        detector.detect(image)
    return _resident_bytes() - before


def _resident_bytes() -> int:
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) * 1024
    raise RuntimeError("/proc/self/status without VmRSS")
