"""LRP at all thresholds beside the AP of every evaluator of COCO metrics that is installed, on real pictures.

python tests/benchmarks/bench_evaluation.py [--data FOLDER]

hotcoco is the product's, pycocotools the authors'; faster-coco-eval and ultrafast-pycocotools are measured where
somebody installed them. Times are the processor's, the least of a few.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import hotcoco
import numpy as np

from pipeline.evaluation.metrics.average_precision import coco_precision
from pipeline.evaluation.metrics.boxes import FoundBoxes, TrueBoxes, found_boxes, true_boxes
from pipeline.evaluation.metrics.lrp import TAU, lrp_curve, mean_optimal_lrp, optimal_lrp
from pipeline.evaluation.metrics.matching import match

DATA = Path(__file__).resolve().parents[3] / "shared/data/evaluation"
REPEATS = 7
OTHERS = ("pycocotools", "faster_coco_eval", "ultrafast_pycocotools")


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
    """Least of a few times of the processor, seconds."""
    taken = []
    for _ in range(REPEATS):
        started = time.process_time()
        measure()
        taken.append(time.process_time() - started)
    return min(taken)


def like_pycocotools(name: str) -> Callable[[dict, list], float] | None:
    """The mean AP by a package with pycocotools' interface, None if it is not installed."""
    try:
        if name == "faster_coco_eval":
            package = importlib.import_module(name)
            coco_class, eval_class = package.COCO, package.COCOeval_faster
        else:
            coco_class = importlib.import_module(f"{name}.coco").COCO
            eval_class = importlib.import_module(f"{name}.cocoeval").COCOeval
    except ImportError:
        return None

    def mean_ap(truth: dict, found: list) -> float:
        with contextlib.redirect_stdout(io.StringIO()):
            coco = coco_class()
            coco.dataset = truth
            coco.createIndex()
            evaluation = eval_class(coco, coco.loadRes([dict(d) for d in found]), "bbox")
            evaluation.evaluate()
            evaluation.accumulate()
            evaluation.summarize()
        return float(evaluation.stats[0])

    return mean_ap


def by_hotcoco(truth: dict, found: list) -> float:
    """From the same dictionaries, as the others get them."""
    coco = hotcoco.COCO(truth)
    evaluation = hotcoco.COCOeval(coco, coco.load_res(found), "bbox")
    evaluation.evaluate()
    evaluation.accumulate()
    precision = evaluation.eval["precision"][:, :, :, 0, -1]
    return float(precision[precision > -1.0].mean())


def side_by_side(data: Path) -> None:
    """All get what was parsed from the files; the time to bring it into their own form counts for all."""
    truth = json.loads((data / "instances_val.json").read_text())
    found = json.loads((data / "result_all_classes.json").read_text())
    for annotation in truth["annotations"]:
        annotation.setdefault("iscrowd", 0)
    categories = [c["id"] for c in truth["categories"]]

    def ours() -> float:
        true, detections = boxes(truth, found)
        matches = match(true, detections, iou_thresholds=np.array([TAU]))
        return mean_optimal_lrp([optimal_lrp(lrp_curve(matches, c)) for c in categories]).lrp

    print(f"{len(truth['images'])} pictures, {len(found)} boxes")
    print(f"LRP at all thresholds: moLRP {ours():.6f}, {1e3 * best_of(ours):.1f} ms")
    evaluators = {name: like_pycocotools(name) for name in OTHERS} | {"hotcoco": by_hotcoco}
    times = {}
    for name, mean_ap in evaluators.items():
        if mean_ap is None:
            print(f"{name}: not installed")
            continue
        value = mean_ap(truth, found)
        times[name] = best_of(partial(mean_ap, truth, found))
        print(f"{name}: mean AP {value:.16f}, {1e3 * times[name]:.1f} ms")
    true, detections = boxes(truth, found)
    measure = partial(coco_precision, true, detections, len(truth["images"]), categories)
    times["hotcoco from columns"] = best_of(measure)
    print(f"hotcoco from columns, as the product has them: {1e3 * times['hotcoco from columns']:.1f} ms")
    fastest = min(times, key=times.__getitem__)
    print(f"LRP needs {best_of(ours) / times[fastest]:.2f} of the time of the fastest, {fastest}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=DATA)
    arguments = parser.parse_args()
    if arguments.data.is_dir():
        side_by_side(arguments.data)


if __name__ == "__main__":
    main()
