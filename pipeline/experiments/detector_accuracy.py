"""Experiment 1: the same detections with the detector's relative accuracy, and with half of it.

The probability of one update is 0.5 + p_area p_det_rel score p_positive_max. The paper's two figures are one
update's: where it gives 0.5 + x = 0.93, half the accuracy gives 0.5 + x / 2 = 0.715, and with more updates of
equal strength the two only come nearer to each other. So every frame is fused on its own here, into a map
that knows nothing, and the figures are means of what single looks say of the places where people are. What
all frames together say is measured beside it: both maps reach the clamp, and the difference is gone.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pipeline.config.fusion import Fusion
from pipeline.experiments.detection_cache import Progress, detections_of
from pipeline.experiments.experiment_report import Experiment, Measure
from pipeline.experiments.refusion import Fused, fuse_again, prepare_with_truth
from pipeline.messages import Detections
from pipeline.mission.prepared import PreparedMission
from pipeline.outputs.map_picture import draw_map

NOMINAL = 0.98
#: frames this far apart are taken; between them nearly nothing changes
EVERY_S = 0.5
#: for the picture: a place is in the camera's view for about 7 s of a lane
_PICTURE_EVERY_S = 7.0
#: what a single look can say at most is said; a box of any allowed size counts in full
_CHANGES: dict[str, object] = {
    "positive_max": 0.5,
    "negative_max": 0.05,
    "tukey_alpha": 0.0,
    "threshold": 0.55,
    "cell_size": 0.5,
}
_WHY = {
    "frames": f"one every {EVERY_S:g} s, each on its own, by the most accurate detector of the plan",
    "p_det_score": "calibrated (see the pool): the probability that the box is right",
    "p_positive_max": "0.5, the greatest there is, and p_negative_max 0.05",
    "tukey_alpha": "0: a box of any allowed size counts in full",
    "threshold": "0.55: with half the accuracy one look of score 0.65 gives 0.66",
    "mean probability": "of the places where a person is, over all frames",
}


def detector_accuracy(mission: Path, out: Path, progress: Progress) -> Experiment:
    """mission: with truth. out: its detections are kept there."""
    prepared = prepare_with_truth(mission)
    every = detections_of(prepared, out / "detections.msgpack", progress)
    fusion = prepared.mission.fusion.model_copy(update=_CHANGES)
    results = _of_the_best(prepared, every)
    alone = _every(prepared, results, EVERY_S)
    full, half = [], []
    for k, result in enumerate(alone):
        progress("single looks", k + 1, len(alone))
        full.append(_fuse(prepared, [result], fusion, NOMINAL))
        half.append(_fuse(prepared, [result], fusion, NOMINAL / 2.0))
    all_full, all_half = (_fuse(prepared, every, fusion, p) for p in (NOMINAL, NOMINAL / 2.0))
    seldom = _every(prepared, results, _PICTURE_EVERY_S)
    maps = [(f"p_det_rel {p:g}", _fuse(prepared, seldom, fusion, p)) for p in (NOMINAL / 2.0, NOMINAL)]
    scores = np.concatenate([result.scores for result in results])
    measures = [
        Measure("mean probability, p_det_rel 0.98", mean_probability(full), "", "0.93", ">=", 0.93),
        Measure("mean probability, p_det_rel 0.49", mean_probability(half), "", "0.71", "<=", 0.71),
        Measure("single looks that found a person", sum(len(f.match.found) for f in full), "", ""),
        Measure("false places in them", sum(len(f.match.false) for f in full), "", ""),
        Measure("all frames, all detectors, 0.98", mean_probability([all_full]), "", ""),
        Measure("all frames, all detectors, 0.49", mean_probability([all_half]), "", ""),
        Measure("median score of the detections", float(np.median(scores)), "", "about 0.88 by its figures"),
    ]
    text = (
        "Nine people, two drones 15 m above the ground at 3 m/s, cameras 45 degrees down, fused twice. One "
        "look of score s can raise a place to 0.5 + 0.98 s / 2: 0.93 needs a score of 0.88. A mean of 0.93 "
        "with the whole accuracy is one of at least 0.715 with half of it: 0.71 is not to be had with it."
    )
    return Experiment(1, "relative accuracy of the detector", text, measures, {"maps": _picture(maps)}, _WHY)


def mean_probability(runs: Sequence[Fused]) -> float:
    """Of the found places with a person, over all runs; 0 if there are none."""
    probabilities: list[float] = []
    for run in runs:
        ids = {pair.location for pair in run.match.found}
        probabilities += [place.probability for place in run.locations if place.id in ids]
    return float(np.mean(probabilities)) if probabilities else 0.0


def _of_the_best(prepared: PreparedMission, results: Sequence[Detections]) -> list[Detections]:
    """Those of the most accurate of the pool's detectors that had a look."""
    by_pool = {result.detector: result.detector.rpartition(":")[2] for result in results}
    best = max(by_pool.values(), key=lambda name: prepared.relative_accuracy[name])
    return [result for result in results if by_pool[result.detector] == best]


def _every(prepared: PreparedMission, results: Sequence[Detections], apart_s: float) -> list[Detections]:
    """The results of the frames next to 0, apart_s, 2 apart_s, .. of each video."""
    step_s = 1.0 / prepared.mission.processing.frame_rate
    start_ns = {s.stream: s.start_ns for s in prepared.streams}
    return [r for r in results if ((r.time_ns - start_ns[r.stream]) * 1e-9 + step_s / 2.0) % apart_s < step_s]


def _fuse(
    prepared: PreparedMission, results: Sequence[Detections], fusion: Fusion, p_detector: float
) -> Fused:
    relative = {detector.id: p_detector for detector in prepared.pool.detectors}
    return fuse_again(prepared, results, fusion, relative)


def _picture(maps: Sequence[tuple[str, Fused]]) -> Figure:
    figure = Figure(figsize=(10, 5.4), dpi=110, layout="constrained")
    for axes, (title, run) in zip(figure.subplots(1, len(maps)), maps, strict=True):
        shown = draw_map(axes, run.fuser.map, run.locations, run.truth)
        axes.set_title(title, fontsize=10)
    figure.colorbar(shown, ax=figure.axes, shrink=0.7, label="probability of a person")
    return figure
