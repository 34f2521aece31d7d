"""Experiment 1: the same detections with the detector's relative accuracy, and with half of it.

The probability of one update is 0.5 + p_area p_det_rel score p_positive_max. The paper's two figures are what
this gives for one update with p_area score p_positive_max = 0.44: 0.5 + 0.98 x 0.44 and 0.5 + 0.49 x 0.44.
So every place is looked at about once here, too. With many looks both maps reach the clamp, and the
difference is gone; that is measured beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pipeline.config.mission import Fusion
from pipeline.experiments.detection_cache import Progress, detections_of
from pipeline.experiments.experiment_report import Experiment, Measure
from pipeline.experiments.refusion import Fused, fuse_again, prepare_with_truth
from pipeline.messages import Detections
from pipeline.outputs.map_picture import draw_map
from pipeline.preflight import PreparedMission

NOMINAL = 0.98
#: a place is in the picture for about 7 s of a lane
INTERVAL_S = 4.0
#: so many first frames are tried, and the figures averaged: which frame is the first is chance
PHASES = 8
#: what a single look can say at most is said; a box of any allowed size counts in full
_CHANGES: dict[str, object] = {
    "positive_max": 0.5,
    "negative_max": 0.05,
    "tukey_alpha": 0.0,
    "threshold": 0.55,
    "cell_size": 0.5,
}
_WHY = {
    "frames": f"one every {INTERVAL_S:g} s: a place is seen about once; means over {PHASES} first frames",
    "p_positive_max": "0.5, the greatest there is, and p_negative_max 0.05",
    "tukey_alpha": "0: a box of any allowed size counts in full",
    "threshold": "0.55: with half the accuracy one look of score 0.65 gives 0.66",
    "mean probability": "of the places where a person is",
}


@dataclass(frozen=True)
class Certainty:
    """probability: mean of the places with a person. found, false: mean counts."""

    probability: float
    found: float
    false: float


def detector_accuracy(mission: Path, out: Path, progress: Progress) -> Experiment:
    """mission: with truth. out: its detections are kept there."""
    prepared = prepare_with_truth(mission)
    results = detections_of(prepared, out / "detections.msgpack", progress)
    fusion = prepared.mission.fusion.model_copy(update=_CHANGES)
    once = [results_at(prepared, results, k * INTERVAL_S / PHASES) for k in range(PHASES)]
    full, half = (_mean([_fuse(prepared, r, fusion, p) for r in once]) for p in (NOMINAL, NOMINAL / 2.0))
    all_full, all_half = (_fuse(prepared, results, fusion, p) for p in (NOMINAL, NOMINAL / 2.0))
    scores = np.concatenate([result.scores for result in results])
    maps = [(f"p_det_rel {p:g}", _fuse(prepared, once[0], fusion, p)) for p in (NOMINAL / 2.0, NOMINAL)]
    measures = [
        Measure("mean probability, p_det_rel 0.98", full.probability, "", "0.93", ">=", 0.93),
        Measure("mean probability, p_det_rel 0.49", half.probability, "", "0.71", "<=", 0.71),
        Measure("people found of 9, p_det_rel 0.98", full.found, "", ""),
        Measure("people found of 9, p_det_rel 0.49", half.found, "", ""),
        Measure("false places, p_det_rel 0.98", full.false, "", ""),
        Measure("all frames, 0.98", _mean([all_full]).probability, "", ""),
        Measure("all frames, 0.49", _mean([all_half]).probability, "", ""),
        Measure("median score of the detections", float(np.median(scores)), "", "about 0.88 by its figures"),
    ]
    text = (
        "Nine people, two drones 15 m above the ground at 3 m/s, cameras 45 degrees down, fused twice. One "
        "look of score s can raise a place to 0.5 + 0.98 s / 2: 0.93 needs a score of 0.88."
    )
    return Experiment(1, "relative accuracy of the detector", text, measures, {"maps": _picture(maps)}, _WHY)


def results_at(prepared: PreparedMission, results: Sequence[Detections], first_s: float) -> list[Detections]:
    """The results of the frames next to first_s, first_s + INTERVAL_S, .. of each video."""
    step_s = 1.0 / prepared.mission.processing.frame_rate
    rates = {s.stream: s.video.frame_rate for s in prepared.streams}
    return [
        result
        for result in results
        if (result.index / rates[result.stream] - first_s + step_s / 2.0) % INTERVAL_S < step_s
    ]


def _fuse(
    prepared: PreparedMission, results: Sequence[Detections], fusion: Fusion, p_detector: float
) -> Fused:
    relative = {detector.id: p_detector for detector in prepared.pool.detectors}
    return fuse_again(prepared, results, fusion, relative)


def _mean(runs: Sequence[Fused]) -> Certainty:
    probabilities = []
    for run in runs:
        ids = {pair.location for pair in run.match.found}
        probabilities += [place.probability for place in run.locations if place.id in ids]
    return Certainty(
        float(np.mean(probabilities)) if probabilities else 0.0,
        float(np.mean([len(run.match.found) for run in runs])),
        float(np.mean([len(run.match.false) for run in runs])),
    )


def _picture(maps: Sequence[tuple[str, Fused]]) -> Figure:
    figure = Figure(figsize=(10, 5.4), dpi=110, layout="constrained")
    for axes, (title, run) in zip(figure.subplots(1, len(maps)), maps, strict=True):
        shown = draw_map(axes, run.fuser.map, run.locations, run.truth)
        axes.set_title(title, fontsize=10)
    figure.colorbar(shown, ax=figure.axes, shrink=0.7, label="probability of a person")
    return figure
