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
    progress("alone")
    memory, taken, worked = _apart(_alone, *job)
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


def _alone(
    model: Path,
    setup: Setup,
    images: Pictures,
    pictures: int,
    warm_up: int,
    score_cutoff: float,
    reading: Reading,
) -> tuple[int, FloatArray, float | None]:
    """Memory and times in this fresh process.

    Bytes by which it grows at most when it opens the model and warms up; seconds for each picture, and the share
    of the wall time without work, if one thread does it all.
    """
    resize(images[0], 64, 64)  # the resize kernel is everybody's, not the detector's
    before = _status_bytes("VmRSS")
    detector = _warm(model, setup, images, warm_up, score_cutoff, reading)
    memory = _status_bytes("VmHWM") - before
    clock = time.thread_time if setup.clock == "processor" else time.perf_counter
    wall, work = time.perf_counter(), time.thread_time()
    taken = _times(detector, images, pictures, clock)
    wall, work = time.perf_counter() - wall, time.thread_time() - work
    one_thread = setup.threads == 1 and setup.provider == "cpu"
    return memory, taken, max(0.0, 1.0 - work / wall) if one_thread else None


def _warm(
    model: Path, setup: Setup, images: Pictures, warm_up: int, score_cutoff: float, reading: Reading
) -> Detector:
    """The detector, opened, and past its first pictures."""
    detector = load_as(
        model, reading, score_threshold=score_cutoff, threads=setup.threads, provider=setup.provider
    )
    for k in range(warm_up):
        detector.detect(images[k % len(images)])
    return detector


def _status_bytes(name: str) -> int:
    path = Path("/proc/self/status")
    if not path.is_file():
        raise InputError(path, "no file", "Linux, to measure memory; or no timing")
    for line in path.read_text(encoding="ascii").splitlines():
        if line.startswith(f"{name}:"):
            return int(line.split()[1]) * 1024
    raise RunFailedError(f"{path} without {name}")


def _times(detector: Detector, images: Pictures, pictures: int, clock: Callable[[], float]) -> FloatArray:
    """Seconds for each picture."""
    return np.array([_timed(detector, images[k % len(images)], clock) for k in range(pictures)])


def _timed(detector: Detector, image: NDArray[np.uint8], clock: Callable[[], float]) -> float:
    started = clock()
    detector.detect(image)
    return clock() - started


def _slow_down(job: tuple[Any, ...], count: int) -> float:
    """Median wall time for a picture with count copies at work, by that of one of them, measured just before."""
    context = multiprocessing.get_context("spawn")
    shared = context.Barrier(count), context.Value("i", 0), context.Value("i", 0)
    with ProcessPoolExecutor(count, context, _join_copies, shared) as pool:
        parts = [part.result() for part in [pool.submit(_copy, *job) for _ in range(count)]]
    alone = next(alone for alone, _ in parts if alone is not None)
    together = np.concatenate([together for _, together in parts])
    return max(1.0, float(np.median(together)) / float(np.median(alone)))


#: of a copy's process: where all copies wait for each other; how many have begun, and have measured
_together: dict[str, Any] = {}


def _join_copies(barrier: Any, begun: Any, measured: Any) -> None:
    _together.update(barrier=barrier, begun=begun, measured=measured)


def _copy(
    model: Path,
    setup: Setup,
    images: Pictures,
    pictures: int,
    warm_up: int,
    score_cutoff: float,
    reading: Reading,
) -> tuple[FloatArray | None, FloatArray]:
    """Seconds for each picture: of the first copy alone, while the others wait (None of those); of all together."""
    barrier, begun, measured = _together["barrier"], _together["begun"], _together["measured"]
    with begun:
        first = begun.value == 0
        begun.value += 1
    try:
        detector = _warm(model, setup, images, warm_up, score_cutoff, reading)
        barrier.wait(_START_TIMEOUT_S)
        alone = _times(detector, images, pictures, time.perf_counter) if first else None
        # the others wait for as long as the first one's pictures take
        barrier.wait()
        return alone, _times(detector, images, pictures, time.perf_counter)
    except Exception:
        barrier.abort()  # or the others would wait
        raise
    finally:
        with measured:
            measured.value += 1
        # whoever is done goes on working, so that the last is not measured alone
        while not barrier.broken and measured.value < barrier.parties:
            detector.detect(images[0])
