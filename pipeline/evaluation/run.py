"""``searchlight evaluate``: the paper's Algorithm eval_protocol, from a file to pool and report."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.config.evaluation import Evaluation, load_evaluation
from pipeline.detection import load_detector
from pipeline.errors import InputError
from pipeline.evaluation.boxes import FoundBoxes, found_boxes, true_boxes
from pipeline.evaluation.cache import Cache
from pipeline.evaluation.dataset import DataSet, require_aspect, sha256_of_file
from pipeline.evaluation.examples import Example, examples
from pipeline.evaluation.faults import FaultLog
from pipeline.evaluation.grid import Execute, Grid, Progress, plan_grid, run_grid
from pipeline.evaluation.lrp import lrp_curve, optimal_lrp
from pipeline.evaluation.matching import match
from pipeline.evaluation.own_folder import CACHE, check_evaluation_directory, evaluation_directory
from pipeline.evaluation.pool_file import write_pool
from pipeline.evaluation.precision import in_precision
from pipeline.evaluation.provenance import provenance
from pipeline.evaluation.read import read_datasets
from pipeline.evaluation.report import render_report, report_figures
from pipeline.evaluation.results import DetectorFile, Results
from pipeline.evaluation.sample import cells_of, found_in, looked_at, sample_of
from pipeline.evaluation.setup_timing import SetupTiming
from pipeline.evaluation.tables import cells_csv, times_csv
from pipeline.evaluation.timings import timings_of
from pipeline.evaluation.unit import Condition, Model, UnitResult
from pipeline.outputs.safe_write import write_bytes, write_text

_PERSON = 1
_Results = dict[tuple[str, Condition], UnitResult]


@dataclass(frozen=True, slots=True)
class Finished:
    """Where things are. pool: None if the evaluation has no timing or no transcoding."""

    report: Path
    pool: Path | None
    results: Results


def evaluate(
    path: Path, out: Path, *, execute: Execute, progress: Progress, say: Callable[[str], None]
) -> Finished:
    """Measure everything that an evaluation file asks for, and write pool, tables, pictures and report.

    out: absent, empty, or of an earlier evaluation, whose finished work in ``cache`` is used again. execute:
    runs the grid's units. Raises InputError for anything that cannot be used.
    """
    started = time.perf_counter()
    evaluation = load_evaluation(path)
    check_evaluation_directory(out)
    faults = FaultLog(evaluation.faults)
    dataset = read_datasets(evaluation, faults)
    if evaluation.transcoding is not None:
        require_aspect(dataset, (evaluation.transcoding.width, evaluation.transcoding.height))
    spent = {"reading": time.perf_counter() - started}
    with evaluation_directory(out):
        models = _models(evaluation, out)
        grid = plan_grid(evaluation, dataset, models)
        for codec in grid.missing_codecs:
            say(f"{codec} is not measured: this build of FFmpeg lacks it")
        timings = timings_of(evaluation, grid, models, out / CACHE / "times", progress)
        keep = evaluation.transcoding is not None and evaluation.transcoding.keep_streams
        found = run_grid(grid, dataset, Cache(out / CACHE), faults, execute, progress, keep, spent)
        for line in faults.lines():
            say(line)
        results, shown = _measured(
            path, evaluation, dataset, grid, models, timings, found, faults, spent, progress
        )
        return _written(out, results, shown, progress)


def _models(evaluation: Evaluation, out: Path) -> tuple[Model, ...]:
    """The detectors, opened once to see that they can be. Accuracy is that of the first setup's provider."""
    provider = evaluation.timing.setups[0].provider if evaluation.timing else "cpu"
    models = []
    for detector in evaluation.detectors:
        file = in_precision(detector, out / "models")
        for setup in evaluation.timing.setups if evaluation.timing else ():
            load_detector(file, score_threshold=evaluation.score_cutoff, provider=setup.provider)
        load_detector(file, score_threshold=evaluation.score_cutoff, provider=provider)
        if detector.card is not None and not detector.card.is_file():
            raise InputError(detector.card, "no file", "the detector's data sheet, or no card")
        models.append(Model(detector.id, file, sha256_of_file(file), provider))
    return tuple(models)


def _measured(
    path: Path,
    evaluation: Evaluation,
    dataset: DataSet,
    grid: Grid,
    models: tuple[Model, ...],
    timings: tuple[SetupTiming, ...],
    found: _Results,
    faults: FaultLog,
    spent: dict[str, float],
    progress: Progress,
) -> tuple[Results, list[Example]]:
    started = time.perf_counter()
    cells = cells_of(evaluation, dataset, grid, found, progress)
    thresholds = {m.id: _threshold(evaluation, dataset, grid, found, m.id) for m in models}
    shown = examples(grid, dataset, models[-1], thresholds[models[-1].id])
    spent["metrics"] = time.perf_counter() - started
    results = Results(
        name=evaluation.name,
        metric=evaluation.pool.metric,
        codec=evaluation.pool.codec,
        score_cutoff=evaluation.score_cutoff,
        detectors=tuple(
            DetectorFile(
                id=d.id,
                model=str(m.path),
                card=None if d.card is None else str(d.card),
                sha256=m.sha256,
                precision=d.precision,
                score_threshold=thresholds[d.id],
            )
            for d, m in zip(evaluation.detectors, models, strict=True)
        ),
        cells=cells,
        timings=timings,
        provenance=provenance(path, evaluation, dataset, grid, faults, _seconds(found), spent),
    )
    return results, shown


def _written(out: Path, results: Results, shown: list[Example], progress: Progress) -> Finished:
    progress("report", 0, 1, "")
    figures = report_figures(results, shown)
    (out / "pictures").mkdir(exist_ok=True)
    for figure in figures:
        write_bytes(out / "pictures" / f"{figure.name}.png", figure.png)
    write_text(out / "cells.csv", cells_csv(results))
    write_text(out / "times.csv", times_csv(results))
    pool = out / "pool.yaml" if results.timings and results.bitrates_bps else None
    if pool is not None:
        write_pool(pool, results)
    write_text(out / "results.json", results.model_dump_json())
    write_text(out / "report.html", render_report(results, figures))
    progress("report", 1, 1, "")
    return Finished(out / "report.html", pool, results)


def _threshold(evaluation: Evaluation, dataset: DataSet, grid: Grid, found: _Results, detector: str) -> float:
    """The score where LRP is least over all conditions together, never below the cut-off; two decimals."""
    pictures = looked_at(grid)
    sample = sample_of(evaluation, dataset, pictures)
    count, t = len(grid.conditions), sample.truth
    true = true_boxes(
        np.concatenate([t.image + k * sample.images for k in range(count)]),
        np.tile(t.category, count),
        np.tile(t.bbox, (count, 1)),
        np.tile(t.area, count),
        np.tile(t.crowd, count),
    )
    parts: list[FoundBoxes] = []
    for k, condition in enumerate(grid.conditions):
        own = found_in([found[q.name, condition] for q in dataset.sequences], detector, pictures)
        parts.append(found_boxes(own.image + k * sample.images, own.category, own.bbox, own.score))
    columns = [
        np.concatenate([getattr(p, name) for p in parts]) for name in ("image", "category", "bbox", "score")
    ]
    best = optimal_lrp(lrp_curve(match(true, found_boxes(*columns), "all", np.array([0.5])), _PERSON))
    return round(min(max(best.threshold, evaluation.score_cutoff), 1.0), 2)


def _seconds(found: _Results) -> dict[str, float]:
    """What the grid's cells took, by part."""
    spent: dict[str, float] = {}
    for result in found.values():
        parts = result.seconds | {"detect": sum(f.detect_s for f in result.found.values())}
        for part, seconds in parts.items():
            spent[part] = spent.get(part, 0.0) + seconds
    return spent
