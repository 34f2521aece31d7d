"""What a detector costs in an inference setup: time for each picture, memory, and the price of sharing.

Everything is measured in processes of its own, one after the other: nothing else of ours runs meanwhile.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from pipeline.config.evaluation import Setup
from pipeline.detection import Detector, Reading, load_as
from pipeline.detection.resize import resize
from pipeline.errors import InputError, RunFailedError
from pipeline.messages import FloatArray

Pictures = list[NDArray[np.uint8]]
_START_TIMEOUT_S = 120.0
AS_FOUND = Reading()


class SetupTiming(BaseModel):
    """Seconds for each picture, from uint8 pixels to boxes, after a warm-up; peak memory in bytes.

    sharing: how many times as long a picture takes when so many copies run side by side, at least 1.
    busy: share of the wall time in which the process did not get to work, where that is known: a machine that
    was not ours alone.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    detector: str
    machine: str
    provider: str
    threads: int
    clock: str
    pictures: int
    minimum_s: float
    mean_s: float
    maximum_s: float
    p95_s: float
    memory_bytes: int
    sharing: dict[int, float]
    busy: float | None


def time_setup(
    detector: str,
    model: Path,
    setup: Setup,
    images: Pictures,
    *,
    pictures: int,
    warm_up: int,
    sharing: tuple[int, ...],
    score_cutoff: float,
    progress: Callable[[str], None],
    reading: Reading = AS_FOUND,
) -> SetupTiming:
    """Measure one detector in one setup on this machine. images: (H, W, 3) each, gone through in turn."""
    job = (model, setup, images, pictures, warm_up, score_cutoff, reading)
    progress("memory")
    memory = _apart(_peak_memory, *job)
    progress("alone")
    taken, worked = _apart(_times, *job)
    slower = {}
    for count in sorted(sharing):
        progress(f"{count} side by side")
        slower[count] = _slow_down(job, count)
    return SetupTiming(
        detector=detector,
        machine=setup.machine,
        provider=setup.provider,
        threads=setup.threads,
        clock=setup.clock,
        pictures=pictures,
        minimum_s=float(taken.min()),
        mean_s=float(taken.mean()),
        maximum_s=float(taken.max()),
        p95_s=float(np.quantile(taken, 0.95)),
        memory_bytes=memory,
        sharing=slower,
        busy=worked,
    )


def _apart(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function in a fresh process."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def _peak_memory(
    model: Path,
    setup: Setup,
    images: Pictures,
    pictures: int,
    warm_up: int,
    score_cutoff: float,
    reading: Reading,
) -> int:
    """Bytes by which this fresh process grows at most when it opens the model and looks at pictures."""
    resize(images[0], 64, 64)  # the resize kernel is everybody's, not the detector's
    before = _status_bytes("VmRSS")
    detector = _opened(model, setup, score_cutoff, reading)
    for k in range(warm_up):
        detector.detect(images[k % len(images)])
    return _status_bytes("VmHWM") - before


def _opened(model: Path, setup: Setup, score_cutoff: float, reading: Reading) -> Detector:
    return load_as(
        model, reading, score_threshold=score_cutoff, threads=setup.threads, provider=setup.provider
    )


def _status_bytes(name: str) -> int:
    path = Path("/proc/self/status")
    if not path.is_file():
        raise InputError(path, "no file", "Linux, to measure memory; or no timing")
    for line in path.read_text(encoding="ascii").splitlines():
        if line.startswith(f"{name}:"):
            return int(line.split()[1]) * 1024
    raise RunFailedError(f"{path} without {name}")


def _times(
    model: Path,
    setup: Setup,
    images: Pictures,
    pictures: int,
    warm_up: int,
    score_cutoff: float,
    reading: Reading,
) -> tuple[FloatArray, float | None]:
    """Seconds for each picture, and the share of the wall time without work, if one thread does it all."""
    detector = _opened(model, setup, score_cutoff, reading)
    clock = time.thread_time if setup.clock == "processor" else time.perf_counter
    for k in range(warm_up):
        detector.detect(images[k % len(images)])
    wall, work = time.perf_counter(), time.thread_time()
    taken = np.array([_timed(detector, images[k % len(images)], clock) for k in range(pictures)])
    wall, work = time.perf_counter() - wall, time.thread_time() - work
    alone = setup.threads == 1 and setup.provider == "cpu"
    return taken, max(0.0, 1.0 - work / wall) if alone else None


def _timed(detector: Detector, image: NDArray[np.uint8], clock: Callable[[], float]) -> float:
    started = clock()
    detector.detect(image)
    return clock() - started


def _slow_down(job: tuple[Any, ...], count: int) -> float:
    """Median wall time for a picture with count copies at work, by that of one copy, measured just before."""
    return max(1.0, _side_by_side(job, count) / _side_by_side(job, 1))


def _side_by_side(job: tuple[Any, ...], count: int) -> float:
    """Median seconds for a picture, over all copies; all work from the first start to the last end."""
    context = multiprocessing.get_context("spawn")
    shared = context.Barrier(count), context.Value("i", 0)
    with ProcessPoolExecutor(count, context, _join_copies, shared) as pool:
        parts = [pool.submit(_copy, *job) for _ in range(count)]
        return float(np.median(np.concatenate([part.result() for part in parts])))


#: of a copy's process: where all copies start together, and how many have measured
_together: dict[str, Any] = {}


def _join_copies(barrier: Any, measured: Any) -> None:
    _together.update(barrier=barrier, measured=measured)


def _copy(
    model: Path,
    setup: Setup,
    images: Pictures,
    pictures: int,
    warm_up: int,
    score_cutoff: float,
    reading: Reading,
) -> FloatArray:
    barrier, measured = _together["barrier"], _together["measured"]
    try:
        detector = _opened(model, setup, score_cutoff, reading)
        for k in range(warm_up):
            detector.detect(images[k % len(images)])
        barrier.wait(_START_TIMEOUT_S)
        clock = time.perf_counter
        return np.array([_timed(detector, images[k % len(images)], clock) for k in range(pictures)])
    except Exception:
        barrier.abort()  # or the others would wait
        raise
    finally:
        with measured:
            measured.value += 1
        # whoever is done goes on working, so that the last is not measured alone
        while not barrier.broken and measured.value < barrier.parties:
            detector.detect(images[0])
