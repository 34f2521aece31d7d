"""What it saves that units of one source share its decoding: the paper's grid, both ways, on the same footage.

python tests/benchmarks/bench_evaluation_sharing.py VIDEO [--frames 150] [--detector configs/detectors/nano.onnx]

4 codecs at 9 bitrates and the pictures as they are: every unit by itself (as it was), and in the bundles of the
product. Seconds of the processor, by what they were spent on; and what two workers that take the dearest piece
first would need by the clock, from the same seconds: so the figures hold on a machine that does other work too.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from pipeline.config.shipped import shipped
from pipeline.evaluation.measuring.bundles import Bundle, bundles, cost
from pipeline.evaluation.measuring.unit import Condition, Model, Unit
from pipeline.evaluation.measuring.work_unit import work
from pipeline.ingest.video.file import open_video

CODECS = ("h264", "h265", "vp9", "av1")
BITRATES = (50e3, 75e3, 100e3, 250e3, 500e3, 1e6, 2.5e6, 5e6, 20e6)
WORKERS = 2


def units(video: Path, frames: int, detector: Path) -> list[Unit]:
    """The paper's grid on the first frames of a video, looked at twice a second."""
    known = open_video(video)
    kept = tuple(range(min(frames, known.frames)))
    step = max(1, round(known.frame_rate / 2))
    conditions = [Condition(), *(Condition(c, b) for c in CODECS for b in BITRATES)]
    return [
        Unit(
            sequence=video.stem, files=(video,), is_video=True, frame_rate_hz=min(known.frame_rate, 30.0),
            kept=kept, looked={k: k // step for k in kept[::step]}, size=(1024, 576), condition=condition,
            keyframe_interval=60, models=(Model("it", detector, "0" * 64),), score_cutoff=0.05,
        )
        for condition in conditions
    ]  # fmt: skip


def timed(name: str, todo: list[Bundle]) -> tuple[float, float]:
    """Seconds spent on sources, and by the clock of two workers."""
    spent, workers = dict[str, float](), [0.0] * WORKERS
    for piece in todo:
        started = time.process_time()
        for result in work(piece):
            for part, seconds in result.seconds.items():
                spent[part] = spent.get(part, 0.0) + seconds
        workers[workers.index(min(workers))] += time.process_time() - started
    total = sum(spent.values())
    parts = ", ".join(
        f"{p} {s:.1f} s ({s / total:.1%})" for p, s in sorted(spent.items(), key=lambda x: -x[1])
    )
    print(f"{name}, {len(todo)} pieces: {sum(workers):.1f} s, {max(workers):.1f} s by the clock; {parts}")
    return spent["source"], max(workers)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("video", type=Path)
    parser.add_argument("--frames", type=int, default=150)
    parser.add_argument("--detector", type=Path, default=shipped("detectors", "nano.onnx"))
    given = parser.parse_args()
    grid = units(given.video, given.frames, given.detector)
    work(tuple(grid[:1]))  # opens the detector
    alone = timed("each unit by itself", [(unit,) for unit in sorted(grid, key=cost, reverse=True)])
    together = timed("in bundles", bundles(grid, WORKERS))
    print(f"sources: 1/{alone[0] / together[0]:.1f} of the time; clock: {together[1] / alone[1] - 1.0:+.1%}")


if __name__ == "__main__":
    main()
