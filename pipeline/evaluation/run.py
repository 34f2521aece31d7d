"""``searchlight evaluate``: the paper's Algorithm eval_protocol, from a file to pool and report."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pipeline.config.evaluation import EvaluatedDetector, Evaluation, load_evaluation
from pipeline.detection import load_detector
from pipeline.errors import InputError
from pipeline.evaluation.datasets.dataset import require_aspect, sha256_of_file
from pipeline.evaluation.datasets.fault_log import FaultLog
from pipeline.evaluation.datasets.read_datasets import read_datasets
from pipeline.evaluation.evaluation_folder import CACHE, check_evaluation_directory, evaluation_directory
from pipeline.evaluation.measuring.cache import Cache
from pipeline.evaluation.measuring.grid import Execute, Progress, plan_grid, run_grid
from pipeline.evaluation.measuring.grid_results import GridResults, cells_of, score_use
from pipeline.evaluation.measuring.operating_points import operating_points
from pipeline.evaluation.measuring.precision import in_precision
from pipeline.evaluation.measuring.setup_timing import SetupTiming
from pipeline.evaluation.measuring.timings import timings_of
from pipeline.evaluation.measuring.unit import Model
from pipeline.evaluation.pool.pool_file import write_pool
from pipeline.evaluation.report.examples import Example, examples
from pipeline.evaluation.report.provenance import provenance
from pipeline.evaluation.report.report import render_report, report_figures
from pipeline.evaluation.report.results import DetectorFile, Results
from pipeline.evaluation.report.tables import cells_csv, times_csv
from pipeline.storage.whole_or_nothing import write_bytes, write_text


@dataclass(frozen=True, slots=True)
class Finished:
    """Where things are. pool: None if the evaluation has no timing."""

    report: Path
    pool: Path | None
    results: Results


def evaluate(
    path: Path,
    out: Path,
    *,
    execute: Execute,
    progress: Progress,
    say: Callable[[str], None],
    workers: int = 1,
) -> Finished:
    """Measure everything that an evaluation file asks for, and write pool, tables, pictures and report.

    out: absent, empty, or of an earlier evaluation, whose finished work in ``cache`` is used again. execute:
    runs the grid's units. workers: threads for the metrics. Raises InputError for anything that cannot be used.
    """
    started = time.perf_counter()
    evaluation = load_evaluation(path)
    check_evaluation_directory(out)
    _check_detectors(evaluation)
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
        by_unit = run_grid(grid, dataset, Cache(out / CACHE), faults, execute, progress, keep, spent)
        for line in faults.lines():
            say(line)
        found = GridResults(evaluation, dataset, grid, by_unit)
        return _finish(path, out, found, models, timings, faults, spent, progress, workers)


def _check_detectors(evaluation: Evaluation) -> None:
    """Open every detector once as every setup would, before anything is written."""
    providers = {setup.provider for setup in evaluation.timing.setups} if evaluation.timing else {"cpu"}
    for detector in evaluation.detectors:
        for provider in providers:
            load_detector(detector.model, score_threshold=evaluation.score_cutoff, provider=provider)
        if detector.card is not None and not detector.card.is_file():
            raise InputError(detector.card, "no file", "the detector's data sheet, or no card")


def _models(evaluation: Evaluation, out: Path) -> tuple[Model, ...]:
    """The detectors in their precision. Accuracy is measured with the first setup's provider."""
    provider = evaluation.timing.setups[0].provider if evaluation.timing else "cpu"
    files = [(d.id, in_precision(d, out / "models")) for d in evaluation.detectors]
    return tuple(Model(name, file, sha256_of_file(file), provider) for name, file in files)


def _finish(
    path: Path,
    out: Path,
    found: GridResults,
    models: tuple[Model, ...],
    timings: tuple[SetupTiming, ...],
    faults: FaultLog,
    spent: dict[str, float],
    progress: Progress,
    workers: int,
) -> Finished:
    started = time.perf_counter()
    cells = cells_of(found, progress, workers)
    detectors = tuple(
        _detector_file(found, d, m) for d, m in zip(found.evaluation.detectors, models, strict=True)
    )
    shown = examples(found.grid, found.dataset, models[-1], detectors[-1].score_threshold)
    spent["metrics"] = time.perf_counter() - started
    results = Results(
        name=found.evaluation.name,
        metric=found.evaluation.pool.metric,
        codec=found.evaluation.pool.codec,
        score_cutoff=found.evaluation.score_cutoff,
        detectors=detectors,
        cells=cells,
        timings=timings,
        provenance=provenance(path, found, faults, spent),
    )
    return _written(out, results, shown, progress)


def _detector_file(found: GridResults, detector: EvaluatedDetector, model: Model) -> DetectorFile:
    use = score_use(found, detector.id)
    return DetectorFile(
        id=detector.id,
        model=str(model.path),
        card=None if detector.card is None else str(detector.card),
        sha256=model.sha256,
        precision=detector.precision,
        score_threshold=use.threshold,
        calibration=use.calibration,
        calibration_error=use.error,
        calibrated_error=use.error_calibrated,
        operating_points=operating_points(found, detector.id, use.threshold),
        scores_given=detector.score_threshold is not None,
    )


def _written(out: Path, results: Results, shown: list[Example], progress: Progress) -> Finished:
    progress("report", 0, 1, "")
    figures = report_figures(results, shown)
    (out / "pictures").mkdir(exist_ok=True)
    for figure in figures:
        write_bytes(out / "pictures" / f"{figure.name}.png", figure.png)
    write_text(out / "cells.csv", cells_csv(results))
    write_text(out / "times.csv", times_csv(results))
    pool = out / "pool.yaml" if results.timings else None
    if pool is not None:
        write_pool(pool, results)
    write_text(out / "results.json", results.model_dump_json())
    write_text(out / "report.html", render_report(results, figures))
    progress("report", 1, 1, "")
    return Finished(out / "report.html", pool, results)
