"""A network in a thread and in a process of its own, side by side: time of a picture, of loading, and memory.

python -m tests.benchmarks.bench_detector_process [--looks 100]

Pictures of 1024 x 576 in turns, one thread each; medians. Memory: proportional set size of the child, which counts
pages that are shared once, beside what one more network adds to a process that has one.
"""

from __future__ import annotations

import argparse
import re
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.config.pool import load_pool
from pipeline.detection import PERSONS, open_pool_detector
from pipeline.mission.stages.detector_process import DetectorProcess

ROOT = Path(__file__).resolve().parents[2]


def pss_mb(pid: int | str) -> float:
    """Of a process."""
    found = re.search(r"^Pss: +(\d+)", Path(f"/proc/{pid}/smaps_rollup").read_text(), re.M)
    assert found is not None
    return int(found[1]) / 1e3


def timed(act: Any) -> tuple[Any, float]:
    """What came of it, and seconds."""
    begun = time.perf_counter()
    return act(), time.perf_counter() - begun


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--looks", type=int, default=100)
    looks = parser.parse_args().looks
    pictures = np.random.default_rng(1).integers(0, 256, (4, 576, 1024, 3), dtype=np.uint8)
    pool = load_pool(ROOT / "configs/pools/demo.yaml").detectors
    open_pool_detector(pool[0]).detect(
        pictures[0]
    )  # what the first one of a process costs is not of the network
    print("network  load s: thread process | ms a picture: thread process | MB more: thread process")
    for row in pool:
        before = pss_mb("self")
        thread, load_s = timed(lambda row=row: open_pool_detector(row))
        thread.detect(pictures[0])
        more = pss_mb("self") - before
        process, process_load_s = timed(lambda row=row: DetectorProcess(row, PERSONS))
        process.detect(pictures[0])
        times: dict[str, list[float]] = {"thread": [], "process": []}
        for k in range(looks):
            for name, detector in (("thread", thread), ("process", process)):
                times[name].append(timed(lambda d=detector, k=k: d.detect(pictures[k % 4]))[1])
        ms = {name: 1e3 * statistics.median(values) for name, values in times.items()}
        memory = pss_mb(process.pid)
        process.close()
        print(
            f"{row.id:8s} {load_s:13.2f} {process_load_s:7.2f} | {ms['thread']:17.2f} {ms['process']:7.2f} |"
            f" {more:13.0f} {memory:7.0f}"
        )


if __name__ == "__main__":
    main()
