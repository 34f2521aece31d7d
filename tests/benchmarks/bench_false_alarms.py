"""False alarms of a pool's detectors on real pictures that hold nobody, and whether they find real people there.

Real pictures are a video (every Nth picture) and, if given, single pictures. Which of them hold somebody is judged
by other networks, trained on real pictures: nobody is there if all of them are below 0.2, somebody is if two of
them agree at 0.5 on a box (IoU 0.5); the rest is left out. Prints for each detector of the pool, at the pool's
threshold: the share of the pictures without a person that get a box, boxes in each of them, and the share of the
agreed people that are found at IoU 0.3. What is measured here must never be trained on, nor thresholds chosen by it.

python tests/benchmarks/bench_false_alarms.py --video VIDEO [--every 15] --judges A.onnx B.onnx .. [--pool POOL.yaml]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pipeline.config.pool import load_pool
from pipeline.detection import load_detector, open_pool_detector
from pipeline.detection.nms import iou
from pipeline.detection.picture_file import read_picture
from pipeline.ingest.video.file import decoded_frames

ROOT = Path(__file__).resolve().parents[2]
POOL = ROOT / "configs" / "pools" / "simulated.yaml"
NOBODY, SOMEBODY = 0.2, 0.5


def pictures(video: Path | None, every: int, files: list[Path]) -> Iterator[np.ndarray]:
    """RGB pictures, one after the other."""
    if video is not None:
        for number, frame in enumerate(decoded_frames(video)):
            if number % every == 0:
                yield frame.to_ndarray(format="rgb24")
    for file in files:
        yield read_picture(file)


def agreed(found: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray | None:
    """Boxes of people that two judges agree on; none if nobody is there; None if that cannot be told."""
    if all(not (scores >= NOBODY).any() for _, scores in found):
        return np.zeros((0, 4))
    sure = [boxes[scores >= SOMEBODY] for boxes, scores in found]
    people: list[np.ndarray] = []
    for k, boxes in enumerate(sure):
        for box in boxes:
            others = any(len(o) and (iou(box, o) >= 0.5).any() for j, o in enumerate(sure) if j != k)
            known = len(people) and (iou(box, np.array(people)) >= 0.5).any()
            if others and not known:
                people.append(box)
    return np.array(people) if people else None


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--video", type=Path)
    parser.add_argument("--every", type=int, default=15)
    parser.add_argument("--pictures", type=Path, nargs="*", default=[])
    parser.add_argument("--judges", type=Path, nargs="+", required=True)
    parser.add_argument("--pool", type=Path, default=POOL)
    given = parser.parse_args()
    judges = [load_detector(file, score_threshold=NOBODY) for file in given.judges]
    pool = [d for d in load_pool(given.pool).detectors if d.model is not None]
    opened = [(d, open_pool_detector(d)) for d in pool]
    alarms = {d.id: [] for d in pool}
    hits = {d.id: 0 for d in pool}
    people = unsure = 0
    for image in pictures(given.video, given.every, given.pictures):
        truth = agreed([judge.detect(image)[:2] for judge in judges])
        if truth is None:
            unsure += 1
            continue
        people += len(truth)
        for row, detector in opened:
            boxes = detector.detect(image)[0]
            if not len(truth):
                alarms[row.id].append(len(boxes))
            elif len(boxes):
                hits[row.id] += sum(bool((iou(box, boxes) >= 0.3).any()) for box in truth)
    for row in pool:
        counts = np.array(alarms[row.id])
        print(
            f"{row.id}: a box in {(counts > 0).mean():.1%} of {len(counts)} pictures without a person, "
            f"{counts.mean():.2f} boxes in each; {hits[row.id]} of {people} people found; "
            f"threshold {row.score_threshold}; {unsure} pictures not judged"
        )


if __name__ == "__main__":
    main()
