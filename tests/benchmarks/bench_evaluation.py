"""LRP at all thresholds beside pycocotools' AP on real pictures.

python tests/benchmarks/bench_evaluation.py [--data FOLDER]
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import time
from collections.abc import Callable
from pathlib import Path

from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from pipeline.evaluation.metrics.boxes import FoundBoxes, TrueBoxes, found_boxes, true_boxes
from pipeline.evaluation.metrics.lrp import lrp_curve, mean_optimal_lrp, optimal_lrp
from pipeline.evaluation.metrics.matching import match

DATA = Path(__file__).resolve().parents[3] / "shared/data/evaluation"
REPEATS = 5


def boxes(truth: dict, found: list) -> tuple[TrueBoxes, FoundBoxes]:
    """The columns that our metrics take."""
    index = {key: k for k, key in enumerate(sorted(image["id"] for image in truth["images"]))}
    marks = truth["annotations"]
    true = true_boxes(
        [index[a["image_id"]] for a in marks],
        [a["category_id"] for a in marks],
        [a["bbox"] for a in marks],
        [a["area"] for a in marks],
    )
    columns = (
        [index[d["image_id"]] for d in found],
        *([d[k] for d in found] for k in ("category_id", "bbox", "score")),
    )
    return true, found_boxes(*columns)


def best_of(measure: Callable[[], object]) -> float:
    """Least of a few wall times, seconds."""
    taken = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        measure()
        taken.append(time.perf_counter() - started)
    return min(taken)


def side_by_side(data: Path) -> None:
    """Both get what was parsed from the files; the time to bring it into their own form counts for both."""
    truth = json.loads((data / "instances_val.json").read_text())
    found = json.loads((data / "result_all_classes.json").read_text())
    for annotation in truth["annotations"]:
        annotation.setdefault("iscrowd", 0)
    categories = [c["id"] for c in truth["categories"]]

    def ours() -> float:
        true, detections = boxes(truth, found)
        matches = match(true, detections)
        return mean_optimal_lrp([optimal_lrp(lrp_curve(matches, c)) for c in categories]).lrp

    def theirs() -> float:
        with contextlib.redirect_stdout(io.StringIO()):
            coco = COCO()
            coco.dataset = truth
            coco.createIndex()
            evaluation = COCOeval(coco, coco.loadRes([dict(d) for d in found]), "bbox")
            evaluation.evaluate()
            evaluation.accumulate()
            evaluation.summarize()
        return float(evaluation.stats[0])

    print(
        f"moLRP {ours():.6f}, mean AP {theirs():.16f} of {len(truth['images'])} pictures, {len(found)} boxes"
    )
    lrp_s, ap_s = best_of(ours), best_of(theirs)
    print(f"LRP {1e3 * lrp_s:.0f} ms, pycocotools' AP {1e3 * ap_s:.0f} ms: {lrp_s / ap_s:.3f} of it")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=DATA)
    arguments = parser.parse_args()
    if arguments.data.is_dir():
        side_by_side(arguments.data)


if __name__ == "__main__":
    main()
