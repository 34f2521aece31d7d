"""Every detector in every inference setup, each measured once for its content and machine."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from pipeline.config.evaluation import Evaluation, Setup, Timing
from pipeline.evaluation.measuring.grid import Grid, Progress
from pipeline.evaluation.measuring.setup_timing import SetupTiming, time_setup
from pipeline.evaluation.measuring.unit import Model
from pipeline.evaluation.measuring.work_unit import first_pictures
from pipeline.evaluation.report.provenance import machine_name
from pipeline.storage.code_digest import code_sha256
from pipeline.storage.whole_or_nothing import write_text

_PICTURES = 12
#: the paper's cut-off: a lower one would time boxes that nobody asks for
_USUAL_CUTOFF = 0.3
#: the code that times depend on
_CODE = ("pipeline.config.layout", "pipeline.detection", "pipeline.evaluation.measuring.setup_timing")


def timings_of(
    evaluation: Evaluation, grid: Grid, models: tuple[Model, ...], folder: Path, progress: Progress
) -> tuple[SetupTiming, ...]:
    """The timings, measured now or kept in folder from an earlier run; none if none are asked for."""
    asked = evaluation.timing
    if asked is None:
        return ()
    jobs = [(model, setup) for model in models for setup in asked.setups]
    images = [] if evaluation.transcoding else _pictures(grid)
    sizes = (
        [evaluation.transcoding.width, evaluation.transcoding.height]
        if evaluation.transcoding
        else _sizes(images)
    )
    timings: list[SetupTiming] = []
    for k, (model, setup) in enumerate(jobs):
        say = partial(_say, progress, k, len(jobs), f"{model.id} on {setup.machine}")
        kept = folder / f"{_key(sizes, asked, setup, model)}.json"
        if not kept.is_file():
            images = images or _pictures(grid)
            measured = _measured(evaluation, asked, setup, model, images, say)
            folder.mkdir(parents=True, exist_ok=True)
            write_text(kept, measured.model_dump_json())
        known = SetupTiming.model_validate_json(kept.read_bytes())
        timings.append(known.model_copy(update={"detector": model.id, "machine": setup.machine}))
    progress("setups", len(jobs), len(jobs), "")
    return tuple(timings)


def _pictures(grid: Grid) -> list[NDArray[np.uint8]]:
    """The first pictures as they are, of as many sequences as it needs."""
    images: list[NDArray[np.uint8]] = []
    for unit in grid.units:
        if unit.condition.codec is None and len(images) < _PICTURES:
            images += first_pictures(unit, _PICTURES - len(images))
    return images


def _sizes(images: list[NDArray[np.uint8]]) -> list[int]:
    return [length for image in images for length in image.shape[:2]]


def _say(progress: Progress, done: int, total: int, what: str, step: str) -> None:
    progress("setups", done, total, f"{what}: {step}")


def _measured(
    evaluation: Evaluation,
    asked: Timing,
    setup: Setup,
    model: Model,
    images: list[NDArray[np.uint8]],
    say: Callable[[str], None],
) -> SetupTiming:
    return time_setup(
        model.id,
        model.path,
        setup,
        images,
        pictures=asked.pictures,
        warm_up=asked.warm_up,
        sharing=asked.sharing,
        score_cutoff=max(evaluation.score_cutoff, _USUAL_CUTOFF),
        progress=say,
    )


def _key(sizes: list[int], asked: Timing, setup: Setup, model: Model) -> str:
    parts = [
        model.sha256,
        setup.model_dump(exclude={"machine"}),
        asked.model_dump(exclude={"setups"}),
        sizes,
        onnxruntime.__version__,
        code_sha256(*_CODE),
        machine_name(),
        os.cpu_count(),
    ]
    return hashlib.sha256(json.dumps(parts).encode("utf-8")).hexdigest()[:40]
